/* A simulation that pushes a field of 128 x 128 x 64 floats for ever, every second one computed into the node's memory: endless URL.
 * It prints a line a second: steps, those lost, and the longest that a step's hand-over took in milliseconds. */
#include "lamina.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { NX = 128, NY = 128, NZ = 64 };

static float field[NX * NY * NZ];

static double now(void) {
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int argc, char **argv) {
    if (argc != 2) return 2;
    lamina_options run = {.generator = argv[1], .name = "endless", .field = "f", .dims = {NX, NY, NZ}, .type = LAMINA_F32};
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) return 1;
    double said = now(), longest = 0;
    unsigned long lost = 0;
    for (unsigned long step = 0;; step++) {
        double begun = now();
        lamina_brick brick = {.dims = {NX, NY, NZ}, .voxels = field};
        void *buffer;
        if (step % 2 && lamina_buffer(client, run.dims, &buffer, NULL, NULL) == 0) brick.voxels = buffer;
        memset((void *)brick.voxels, (int)(step % 60), sizeof field);
        if (lamina_push(client, step, (double)step, &brick) < 0) lost++;
        double ended = now();
        if (ended - begun > longest) longest = ended - begun;
        if (ended - said > 1) {
            printf("%lu %lu %.0f\n", step, lost, 1e3 * longest);
            fflush(stdout);
            said = ended;
            longest = 0;
        }
    }
}
