/* Nodes that leave while they are spoken to, and one that never answers: left URL MUTE_URL. A signal would end this. */
#include "lamina.h"

#include <stdio.h>
#include <time.h>

static float values[64 * 64 * 64];

static lamina_client *connected(const char *url, double deadline_secs) {
    lamina_options run = {
        .generator = url, .name = "left", .field = "f", .dims = {64, 64, 64}, .type = LAMINA_F32, .full_policy = LAMINA_BLOCK};
    run.deadline_secs = deadline_secs;
    lamina_client *client;
    if (lamina_connect(&run, &client) < 0) printf("%s\n", lamina_error());
    return client;
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    lamina_brick whole = {.dims = {64, 64, 64}, .voxels = values};
    for (int n = 0; n < 40; n++) {
        lamina_client *client = connected(argv[1], 0.3);
        if (client == NULL) return 1;
        for (int step = 0; step < 3; step++)
            if (lamina_push(client, (uint64_t)step, 0, &whole) >= 0) return 1;
        lamina_close(client, NULL);
    }

    time_t begun = time(NULL);
    lamina_client *client = connected(argv[2], 0.2);
    int code = lamina_push(client, 0, 0, &whole);
    lamina_close(client, NULL);
    if (code != LAMINA_UNREACHABLE && code != LAMINA_DEADLINE) printf("%d %s\n", code, lamina_error());
    /* With the default deadline, of five seconds, it would take five. */
    return (code == LAMINA_UNREACHABLE || code == LAMINA_DEADLINE) && time(NULL) - begun < 5 ? 0 : 1;
}
