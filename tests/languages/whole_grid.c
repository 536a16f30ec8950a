/* Each rank knows its own bricks; rank 0 has none, rank r one of 3 r + 1 points from (5, 2 r, 1) on. */
#include "lamina_mpi.h"

#include <stdio.h>

int main(int argc, char **argv) {
    int rank, ranks;
    uint64_t dims[3];
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    lamina_brick brick = {.start = {5, 2 * (uint64_t)rank, 1}, .dims = {3 * (uint64_t)rank + 1, 1, 1}};
    lamina_whole_grid(MPI_COMM_WORLD, &brick, rank > 0, dims);
    printf("%d %d %d\n", (int)dims[0], (int)dims[1], (int)dims[2]);
    return MPI_Finalize();
}
