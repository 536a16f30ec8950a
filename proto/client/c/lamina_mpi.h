/* Opens a run of all ranks of an MPI communicator. Only this file needs MPI; the library does not. */
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

#ifdef __cplusplus
}
#endif

#endif
