/* The blob of simulation.c on meshes of cells: points that are shifted off their lattice, in hexahedra, tetrahedra, wedges, pyramids or
 * polyhedra. */
#include "cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const int FACES[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
/* A cube's parts along its diagonal from corner 0 to 6, so that neighbors share faces. */
static const int TETRAHEDRA[6][4] = {{0, 1, 2, 6}, {0, 2, 3, 6}, {0, 3, 7, 6}, {0, 7, 4, 6}, {0, 4, 5, 6}, {0, 5, 1, 6}};
static const int WEDGES[2][6] = {{0, 1, 2, 4, 5, 6}, {0, 2, 3, 4, 6, 7}};
/* Each on a face, with its top at the cube's middle, which is a point of its own. */
enum { TET = 10, HEX = 12, WEDGE = 13, PYRAMID = 14 };

static void numbers(conduit_node *mesh, const char *path, const int64_t *values, int64_t count) {
    conduit_node_set_path_int64_ptr(mesh, path, (int64_t *)values, count);
}

void cell_mesh(conduit_node *mesh, const char *layout, struct box box, double (*density)(double, double, double, int), int step) {
    int nx = box.points[0], ny = box.points[1], nz = box.points[2], cx = nx - 1, cy = ny - 1, cz = nz - 1;
    int mixed = !strcmp(layout, "mixed"), polyhedra = !strcmp(layout, "polyhedra"), tetrahedra = !strcmp(layout, "tetrahedra");
    int64_t points = (int64_t)nx * ny * nz, cubes = (int64_t)cx * cy * cz, all = points + (mixed ? cubes : 0);
    double *at[3];
    for (int a = 0; a < 3; a++) at[a] = malloc(sizeof(double) * (size_t)all);
    for (int k = 0; k < nz; k++)
        for (int j = 0; j < ny; j++)
            for (int i = 0; i < nx; i++) {
                int64_t n = i + (int64_t)nx * (j + (int64_t)ny * k);
                double place[3] = {i, j, k};
                /* Inner points lie up to a third of a cell off, by where the whole grid has them; faces stay flat where shapes change. */
                int inner = i > 0 && j > 0 && i < cx && j < cy && !mixed;
                for (int a = 0; a < 3; a++)
                    at[a][n] = box.origin[a] + box.h * (place[a] + (inner && a < 2 ? 0.33 * sin(1.7 * i + 2.3 * j + 3.1 * (k + box.layer)) : 0.0));
            }
    int64_t *connectivity = malloc(sizeof(int64_t) * (size_t)cubes * 36), *sizes = malloc(sizeof(int64_t) * (size_t)cubes * 6);
    int64_t *shapes = malloc(sizeof(int64_t) * (size_t)cubes * 6), *faces = malloc(sizeof(int64_t) * (size_t)cubes * 24);
    int64_t used = 0, count = 0;
    for (int64_t n = 0; n < cubes; n++) {
        int i = (int)(n % cx), j = (int)(n / cx % cy), k = (int)(n / cx / cy);
        int64_t first = i + (int64_t)nx * (j + (int64_t)ny * k), up = (int64_t)nx * ny;
        int64_t corner[8] = {first, first + 1, first + 1 + nx, first + nx, first + up, first + up + 1, first + up + 1 + nx, first + up + nx};
        if (mixed)
            for (int a = 0; a < 3; a++) {
                at[a][points + n] = 0;
                for (int c = 0; c < 8; c++) at[a][points + n] += at[a][corner[c]] / 8;
            }
        /* Layers of hexahedra, of wedges and of pyramids. */
        int kind = tetrahedra ? TET : mixed && k % 3 == 1 ? WEDGE : mixed && k % 3 == 2 ? PYRAMID : HEX;
        int parts = polyhedra || kind == HEX ? 1 : kind == WEDGE ? 2 : 6;
        for (int p = 0; p < parts; p++, count++) {
            int64_t before = used;
            shapes[count] = kind;
            if (polyhedra) {
                for (int f = 0; f < 6; f++) {
                    connectivity[used++] = n * 6 + f;
                    for (int c = 0; c < 4; c++) faces[(n * 6 + f) * 4 + c] = corner[FACES[f][c]];
                }
            } else if (kind == HEX) {
                for (int c = 0; c < 8; c++) connectivity[used++] = corner[c];
            } else if (kind == TET) {
                for (int c = 0; c < 4; c++) connectivity[used++] = corner[TETRAHEDRA[p][c]];
            } else if (kind == WEDGE) {
                for (int c = 0; c < 6; c++) connectivity[used++] = corner[WEDGES[p][c]];
            } else {
                for (int c = 0; c < 4; c++) connectivity[used++] = corner[FACES[p][3 - c]];
                connectivity[used++] = points + n;
            }
            sizes[count] = used - before;
        }
    }
    conduit_node_set_path_char8_str(mesh, "coordsets/coords/type", "explicit");
    const char *axes[3] = {"coordsets/coords/values/x", "coordsets/coords/values/y", "coordsets/coords/values/z"};
    for (int a = 0; a < 3; a++) conduit_node_set_path_float64_ptr(mesh, axes[a], at[a], all);
    conduit_node_set_path_char8_str(mesh, "topologies/mesh/coordset", "coords");
    if (!strcmp(layout, "structured")) {
        conduit_node_set_path_char8_str(mesh, "topologies/mesh/type", "structured");
        conduit_node_set_path_float64(mesh, "topologies/mesh/elements/dims/i", cx);
        conduit_node_set_path_float64(mesh, "topologies/mesh/elements/dims/j", cy);
        conduit_node_set_path_float64(mesh, "topologies/mesh/elements/dims/k", cz);
    } else {
        const char *shape = polyhedra ? "polyhedral" : tetrahedra ? "tet" : mixed ? "mixed" : "hex";
        conduit_node_set_path_char8_str(mesh, "topologies/mesh/type", "unstructured");
        conduit_node_set_path_char8_str(mesh, "topologies/mesh/elements/shape", shape);
        numbers(mesh, "topologies/mesh/elements/connectivity", connectivity, used);
        if (mixed) {
            numbers(mesh, "topologies/mesh/elements/shapes", shapes, count);
            conduit_node_set_path_int64(mesh, "topologies/mesh/elements/shape_map/hex", HEX);
            conduit_node_set_path_int64(mesh, "topologies/mesh/elements/shape_map/wedge", WEDGE);
            conduit_node_set_path_int64(mesh, "topologies/mesh/elements/shape_map/pyramid", PYRAMID);
        }
        if (mixed || polyhedra) numbers(mesh, "topologies/mesh/elements/sizes", sizes, count);
        if (polyhedra) {
            conduit_node_set_path_char8_str(mesh, "topologies/mesh/subelements/shape", "quad");
            numbers(mesh, "topologies/mesh/subelements/connectivity", faces, cubes * 24);
        }
    }
    /* Of the points; of structured cells, that of their middles. */
    int of_cells = !strcmp(layout, "structured");
    int64_t values = of_cells ? cubes : all;
    float *rho = malloc(sizeof(float) * (size_t)values);
    for (int64_t n = 0; n < values; n++) {
        double place[3] = {at[0][n], at[1][n], at[2][n]};
        if (of_cells) {
            int64_t first = n % cx + (int64_t)nx * (n / cx % cy + (int64_t)ny * (n / cx / cy)), up = (int64_t)nx * ny;
            int64_t corner[8] = {first, first + 1, first + 1 + nx, first + nx, first + up, first + up + 1, first + up + 1 + nx, first + up + nx};
            for (int a = 0; a < 3; a++) {
                place[a] = 0;
                for (int c = 0; c < 8; c++) place[a] += at[a][corner[c]] / 8;
            }
        }
        rho[n] = (float)density(place[0], place[1], place[2], step);
    }
    conduit_node_set_path_char8_str(mesh, "fields/rho/association", of_cells ? "element" : "vertex");
    conduit_node_set_path_char8_str(mesh, "fields/rho/topology", "mesh");
    conduit_node_set_path_float32_ptr(mesh, "fields/rho/values", rho, values);
    for (int a = 0; a < 3; a++) free(at[a]);
    free(connectivity), free(sizes), free(shapes), free(faces), free(rho);
}
