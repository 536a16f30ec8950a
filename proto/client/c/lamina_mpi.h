/* A run of all ranks of an MPI communicator. Only this file needs MPI; the library does not. */
#ifndef LAMINA_MPI_H
#define LAMINA_MPI_H

#include "lamina.h"

#include <mpi.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As lamina_connect, with rank and ranks of `comm`. Each rank calls it for itself: it is not collective. */
static inline int32_t lamina_open_mpi(MPI_Comm comm, const lamina_options *run, lamina_client **client) {
    lamina_options all = *run;
    int rank, ranks;
    MPI_Comm_rank(comm, &rank);
    MPI_Comm_size(comm, &ranks);
    all.rank = (uint32_t)rank;
    all.ranks = (uint32_t)ranks;
    return lamina_connect(&all, client);
}

/* The sample points of a grid that no rank knows as a whole, as of codes with boxes: so many along x, y and z that `count` bricks of this
   rank (or none), and those of all others, are in it. Collective: all ranks of `comm` call it, before they open the run. Of each brick
   only `start` and `dims` are read. Bricks begin at index 0 or later: where a code's own begin elsewhere, take their least index off. */
static inline void lamina_whole_grid(MPI_Comm comm, const lamina_brick *bricks, size_t count, uint64_t dims[3]) {
    uint64_t own[3] = {0, 0, 0};
    for (size_t n = 0; n < count; n++) {
        for (int axis = 0; axis < 3; axis++) {
            uint64_t end = bricks[n].start[axis] + bricks[n].dims[axis];
            own[axis] = end > own[axis] ? end : own[axis];
        }
    }
    MPI_Allreduce(own, dims, 3, MPI_UINT64_T, MPI_MAX, comm);
}

#ifdef __cplusplus
}
#endif

#endif
