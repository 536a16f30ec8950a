/* The blob of proto/client/c/blob.c in several bricks of rank 0, and none of rank 1: bricks URL RANK 2. */
#include "lamina.h"

#include <stdio.h>
#include <stdlib.h>

enum { NX = 24, NY = 20, NZ = 16, STEPS = 3 };

static double density[NZ][NY][NX], heat[NZ][NY][NX];

static lamina_brick part(size_t x0, size_t y0, size_t z0, size_t x1, size_t y1, size_t z1) {
    lamina_brick brick = {
        .start = {x0, y0, z0},
        .dims = {x1 - x0, y1 - y0, z1 - z0},
        .strides = {1, NX, NX * NY},
        .voxels = &density[z0][y0][x0],
        .colors = &heat[z0][y0][x0],
    };
    return brick;
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int rank = atoi(argv[2]);
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
    };
    lamina_client *client;
    /* Rank and ranks are the launcher's. */
    if (lamina_connect(&run, &client) < 0) return 1;
    for (int step = 0; step < STEPS; step++) {
        for (int k = 0; k < NZ; k++)
            for (int j = 0; j < NY; j++)
                for (int i = 0; i < NX; i++) {
                    double x = 0.1 * i - 0.8 - 0.2 * step, y = 0.1 * j - 1.0, z = 0.1 * k - 0.8;
                    density[k][j][i] = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z));
                    heat[k][j][i] = x + step;
                }
        lamina_brick parts[] = {part(0, 0, 0, NX, NY, 5), part(0, 0, 5, 7, NY, NZ), part(7, 0, 5, NX, NY - 1, NZ),
                                part(7, NY - 1, 5, NX, NY, NZ)};
        size_t count = rank == 0 ? sizeof parts / sizeof *parts : 0;
        if (lamina_push_bricks(client, (uint64_t)step, 0.1 * step, parts, count) < 0) {
            printf("%s\n", lamina_error());
            return 1;
        }
    }
    lamina_summary summary = {0};
    lamina_close(client, &summary);
    printf("pushed %d dropped %d lost %d\n", (int)summary.pushed, (int)summary.dropped, (int)summary.lost);
    return 0;
}
