/* Says what people ask for, until they ask for the end: steered URL. */
#define _POSIX_C_SOURCE 199309L
#include "lamina.h"

#include <stdio.h>
#include <time.h>

static float values[8 * 8 * 8];

int main(int argc, char **argv) {
    if (argc != 2) return 2;
    const lamina_number numbers[] = {{"inflow", 1, 0, 2}, {"angle", 0, -90, 90}};
    const lamina_options run = {.generator = argv[1], .name = "steered", .field = "f", .dims = {8, 8, 8}, .type = LAMINA_F32,
                                .steering = 1, .number_count = 2, .numbers = numbers};
    const lamina_brick whole = {.dims = {8, 8, 8}, .voxels = values};
    const struct timespec nap = {0, 10 * 1000 * 1000};
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) return 1;
    lamina_request request = {.what = LAMINA_NOTHING};
    int paused = 0;
    for (uint64_t step = 0; request.what != LAMINA_STOP && step < 6000; step++) {
        if (!paused) lamina_push(client, step, 0, &whole);
        nanosleep(&nap, NULL);
        while (request.what != LAMINA_STOP && lamina_steering(client, &request) > 0) {
            if (request.what == LAMINA_SET) printf("%s = %.2f\n", numbers[request.number].name, request.value);
            else printf("%s\n", request.what == LAMINA_PAUSE ? "pause" : request.what == LAMINA_RESUME ? "resume" : "stop");
            paused = request.what == LAMINA_PAUSE || (paused && request.what == LAMINA_SET);
        }
    }
    lamina_close(client, NULL);
    return 0;
}
