#ifndef CELLS_H
#define CELLS_H

#include <catalyst.h>

/* Points of a lattice, `h` apart from `origin` on; the first of them are on layer `layer` of the whole grid. */
struct box {
    int points[3], layer;
    double origin[3], h;
};

/* Writes a Blueprint mesh over the box to `mesh`, with the field rho: layout structured, hexahedra, tetrahedra, mixed or polyhedra. */
void cell_mesh(conduit_node *mesh, const char *layout, struct box box, double (*density)(double, double, double, int), int step);

#endif
