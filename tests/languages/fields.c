/* A velocity beside a density, of which its magnitude is shown: in the node's own memory, or from the process's: fields URL RANK 1. */
#include "lamina.h"

#include <stdio.h>

enum { NX = 24, NY = 20, NZ = 16, STEPS = 3 };

static float density[NZ][NY][NX];
static double velocity[3][NZ][NY][NX];

int main(int argc, char **argv) {
    if (argc < 2) return 2;
    lamina_field more[] = {{"v.x", LAMINA_F64}, {"v.y", LAMINA_F64}, {"v.z", LAMINA_F64}};
    lamina_options run = {
        .generator = argv[1],
        .name = "fields",
        .field = "density",
        .dims = {NX, NY, NZ},
        .type = LAMINA_F32,
        .more_fields = more,
        .more_field_count = 3,
        .shown = "magnitude(v)",
    };
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) return 1;
    for (int step = 0; step < STEPS; step++) {
        if (lamina_wants(client, (uint64_t)step) != 1) return 1;
        if (lamina_diagnostic(client, "residual", 0.5 * step) != 0) return 1;
        void *first = density, *fields[] = {velocity[0], velocity[1], velocity[2]};
        if (step > 0 && lamina_buffer(client, run.dims, &first, NULL, fields) < 0) return 1;
        float *rho = first;
        double *v[] = {fields[0], fields[1], fields[2]};
        for (int n = 0; n < NX * NY * NZ; n++) {
            int i = n % NX, j = n / NX % NY, k = n / (NX * NY);
            rho[n] = 1;
            v[0][n] = 0.25 * i + step;
            v[1][n] = 0.5 * j;
            v[2][n] = 0.125 * k * i;
        }
        lamina_array arrays[] = {{v[0], 0}, {v[1], LAMINA_F64}, {v[2], 0}};
        lamina_brick brick = {.dims = {NX, NY, NZ}, .voxels = first, .more = arrays};
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
