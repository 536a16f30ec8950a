/* A field on a rectilinear grid, denser at the beginning of x and towards the end of z: uneven URL RANK 1. */
#include "lamina.h"

#include <stdio.h>

enum { NX = 24, NY = 20, NZ = 16, STEPS = 3 };

static double x[NX], z[NZ], u[NZ][NY][NX];

int main(int argc, char **argv) {
    if (argc < 2) return 2;
    for (int i = 0; i < NX; i++) x[i] = 0.125 * i * i;
    for (int k = 0; k < NZ; k++) z[k] = -0.25 * (NZ - 1 - k) * (NZ - 1 - k);
    lamina_options run = {
        .generator = argv[1],
        .name = "uneven",
        .field = "u",
        .dims = {NX, NY, NZ},
        .spacing = {1, 2, 1},
        .type = LAMINA_F64,
        .coordinates = {x, NULL, z},
    };
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) {
        printf("%s\n", lamina_error());
        return 1;
    }
    for (int step = 0; step < STEPS; step++) {
        for (int k = 0; k < NZ; k++)
            for (int j = 0; j < NY; j++)
                for (int i = 0; i < NX; i++) u[k][j][i] = x[i] + 0.5 * j * (step + 1) - z[k];
        lamina_brick brick = {.dims = {NX, NY, NZ}, .voxels = u};
        if (lamina_push(client, (uint64_t)step, 0.1 * step, &brick) < 0) {
            printf("%s\n", lamina_error());
            return 1;
        }
    }
    lamina_summary summary = {0};
    lamina_close(client, &summary);
    printf("pushed %d dropped %d lost %d\n", (int)summary.pushed, (int)summary.dropped, (int)summary.lost);
    return 0;
}
