/* A blob that drifts, colored by its heat, pushed in slabs by 1 to 16 ranks: blob URL RANK RANKS. The fields lie inside of
 * one layer of ghost cells, and are read from there. */
#include "lamina.h"

#include <stdio.h>
#include <stdlib.h>

enum { NX = 24, NY = 20, NZ = 16, STEPS = 3 };

/* x fastest; index 0 is a ghost cell. */
static double density[NZ + 2][NY + 2][NX + 2], heat[NZ + 2][NY + 2][NX + 2];

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "usage: blob URL RANK RANKS\n");
        return 2;
    }
    int rank = atoi(argv[2]), ranks = atoi(argv[3]);
    int first = NZ * rank / ranks, beyond = NZ * (rank + 1) / ranks;

    lamina_options run = {
        .generator = argv[1],
        .name = "blob",
        .field = "density",
        .dims = {NX, NY, NZ},
        .spacing = {0.1, 0.1, 0.1},
        .origin = {-1.2, -1.0, -0.8},
        .type = LAMINA_F64,
        .color_field = "heat",
        .color_type = LAMINA_F64,
        .rank = (uint32_t)rank,
        .ranks = (uint32_t)ranks,
    };
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) fprintf(stderr, "not shown: %s\n", lamina_error());
    for (int step = 0; step < STEPS; step++) {
        for (int k = first; k < beyond; k++)
            for (int j = 0; j < NY; j++)
                for (int i = 0; i < NX; i++) {
                    double x = 0.1 * i - 0.8 - 0.2 * step, y = 0.1 * j - 1.0, z = 0.1 * k - 0.8;
                    density[k - first + 1][j + 1][i + 1] = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z));
                    heat[k - first + 1][j + 1][i + 1] = x + step;
                }
        lamina_brick brick = {
            .start = {0, 0, (uint64_t)first},
            .dims = {NX, NY, (uint64_t)(beyond - first)},
            .strides = {1, NX + 2, (NX + 2) * (NY + 2)},
            .voxels = &density[1][1][1],
            .colors = &heat[1][1][1],
        };
        /* Without a connection the simulation goes on, unseen. */
        if (client && lamina_push(client, (uint64_t)step, 0.1 * step, &brick) < 0)
            fprintf(stderr, "step %d not shown: %s\n", step, lamina_error());
    }
    lamina_summary summary = {0};
    lamina_close(client, &summary);
    printf("pushed %d dropped %d lost %d\n", (int)summary.pushed, (int)summary.dropped, (int)summary.lost);
    return 0;
}
