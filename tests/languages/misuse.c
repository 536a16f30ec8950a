/* Everything a simulation in C may get wrong, against a node that is not there, but for what cannot be told from right. */
#include "lamina.h"

#include <stdio.h>
#include <string.h>

static int wrong = 0;

static void expect(const char *what, int code, int wanted, const char *words) {
    int said = strstr(lamina_error(), words) != NULL;
    if (code != wanted || !said) {
        printf("%s: %d \"%s\", not %d \"%s\"\n", what, code, lamina_error(), wanted, words);
        wrong = 1;
    }
}

static lamina_options right(const char *generator) {
    lamina_options run = {.generator = generator, .name = "misuse", .field = "f", .dims = {4, 3, 2}, .type = LAMINA_F32};
    return run;
}

int main(int argc, char **argv) {
    if (argc != 2) return 2;
    float values[24] = {0};
    lamina_client *client = (lamina_client *)values;
    lamina_options run;

    if (strcmp(lamina_error(), "") != 0) wrong = 1;
    expect("no options", lamina_connect(NULL, &client), LAMINA_INVALID, "run");
    if (client != NULL) wrong = 1;
    run = right(argv[1]);
    expect("no place for the client", lamina_connect(&run, NULL), LAMINA_INVALID, "client");
    run.type = 0;
    expect("no type", lamina_connect(&run, &client), LAMINA_INVALID, "type");
    run = right(argv[1]);
    run.type = -7;
    expect("a type of its own", lamina_connect(&run, &client), LAMINA_INVALID, "-7 is none of");
    run = right(argv[1]);
    run.name = NULL;
    expect("no name", lamina_connect(&run, &client), LAMINA_INVALID, "name: is not stated");
    run = right(argv[1]);
    run.field = "\xff";
    expect("a field that is no text", lamina_connect(&run, &client), LAMINA_INVALID, "field: is not UTF-8");
    run = right(argv[1]);
    run.dims[1] = 0;
    expect("no points", lamina_connect(&run, &client), LAMINA_INVALID, "grid");
    run = right(argv[1]);
    run.dims[0] = run.dims[1] = UINT64_MAX;
    expect("absurdly many points", lamina_connect(&run, &client), LAMINA_INVALID, "dims");
    run = right(argv[1]);
    run.spacing[2] = -1;
    expect("a negative spacing", lamina_connect(&run, &client), LAMINA_INVALID, "grid");
    struct {
        lamina_options known;
        double later;
    } newer = {.known = right(argv[1]), .later = 1};
    expect("a newer header", lamina_connect_sized(&newer.known, sizeof newer, &client), LAMINA_INVALID, "newer");
    /* What is behind the type of the voxels is not read of a program that does not know it. */
    run = right("no address");
    run.full_policy = 9;
    size_t known = offsetof(lamina_options, color_type);
    expect("an older header", lamina_connect_sized(&run, known, &client), LAMINA_INVALID, "http://HOST:PORT");
    run = right(argv[1]);
    run.color_field = "heat";
    expect("colors without a type", lamina_connect(&run, &client), LAMINA_INVALID, "color_type");
    run = right(argv[1]);
    run.full_policy = 9;
    expect("a policy of its own", lamina_connect(&run, &client), LAMINA_INVALID, "full_policy");
    run = right(argv[1]);
    run.deadline_secs = -1;
    expect("a deadline before now", lamina_connect(&run, &client), LAMINA_INVALID, "deadline_secs");
    run = right("localhost");
    expect("no address", lamina_connect(&run, &client), LAMINA_INVALID, "http://HOST:PORT");

    /* A node that is not there is no error of the run's, only of its steps. */
    run = right(argv[1]);
    expect("nobody there yet", lamina_connect(&run, &client), 0, "");
    lamina_brick whole = {.dims = {4, 3, 2}, .voxels = values}, brick;
    expect("nobody there", lamina_push(client, 0, 0, &whole), LAMINA_UNREACHABLE, "refused");
    expect("nobody there to want it", lamina_wants(client, 1), LAMINA_UNREACHABLE, "refused");
    expect("no client to ask", lamina_wants(NULL, 1), LAMINA_INVALID, "client");
    expect("a step before the first", lamina_wants(client, (uint64_t)-1), LAMINA_INVALID, "step");
    expect("no diagnostic's name", lamina_diagnostic(client, "kinetic energy", 1), LAMINA_INVALID, "letters, digits");
    expect("a name that is none", lamina_diagnostic(client, NULL, 1), LAMINA_INVALID, "NULL");
    expect("no brick", lamina_push(client, 1, 0, NULL), LAMINA_INVALID, "brick");
    expect("no client", lamina_push(NULL, 1, 0, &whole), LAMINA_INVALID, "client");
    brick = whole;
    brick.voxels = NULL;
    expect("no voxels", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "brick.voxels: is NULL");
    brick = whole;
    brick.voxels = (const char *)values + 1;
    expect("voxels between voxels", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "not aligned");
    brick = whole;
    brick.type = LAMINA_F64;
    expect("another type", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "float64 voxels of f; the run has float32");
    brick = whole;
    brick.dims[2] = 0;
    expect("an empty brick", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "is none");
    brick = whole;
    brick.dims[0] = brick.dims[1] = brick.dims[2] = UINT64_MAX;
    expect("a brick beyond counting", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "beyond counting");
    brick = whole;
    brick.dims[0] = (uint64_t)1 << 62;
    expect("a brick beyond memory", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "brick");
    brick = whole;
    brick.strides[0] = 1;
    expect("strides of which some are 0", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "is none");
    brick = whole;
    brick.strides[0] = brick.strides[1] = 1;
    brick.strides[2] = (uint64_t)-1;
    expect("backwards", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "negative");
    brick = whole;
    brick.color_type = LAMINA_F32;
    expect("a type of colors that the run does not name", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "color_field");
    brick = whole;
    brick.colors = values;
    expect("colors that the run does not name", lamina_push(client, 1, 0, &brick), LAMINA_INVALID, "color_field");

    lamina_summary summary;
    lamina_close(NULL, &summary);
    lamina_close(client, &summary);
    /* All but the one without a client. */
    if (summary.pushed != 0 || summary.lost != 14 || summary.run_dropped_steps != -1) {
        printf("pushed %d, lost %d\n", (int)summary.pushed, (int)summary.lost);
        wrong = 1;
    }
    return wrong;
}
