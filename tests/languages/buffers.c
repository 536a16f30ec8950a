/* The blob of proto/client/c/blob.c by one rank, computed into the node's own memory: buffers URL. */
#include "lamina.h"

#include <stdio.h>

enum { NX = 24, NY = 20, NZ = 16, STEPS = 3 };

int main(int argc, char **argv) {
    if (argc < 2) return 2;
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
    if (lamina_connect(&run, &client) < 0) return 1;
    for (int step = 0; step < STEPS; step++) {
        void *voxels, *colors;
        if (lamina_buffer(client, run.dims, &voxels, &colors, NULL) < 0) return 1;
        double *density = voxels, *heat = colors;
        for (int k = 0; k < NZ; k++)
            for (int j = 0; j < NY; j++)
                for (int i = 0; i < NX; i++) {
                    double x = 0.1 * i - 0.8 - 0.2 * step, y = 0.1 * j - 1.0, z = 0.1 * k - 0.8;
                    *density++ = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z));
                    *heat++ = x + step;
                }
        lamina_brick brick = {.dims = {NX, NY, NZ}, .voxels = voxels, .colors = colors};
        if (lamina_push(client, (uint64_t)step, 0.1 * step, &brick) < 0) return 1;
    }
    lamina_summary summary = {0};
    lamina_close(client, &summary);
    printf("pushed %d dropped %d lost %d\n", (int)summary.pushed, (int)summary.dropped, (int)summary.lost);
    return 0;
}
