/* What a simulation in C or C++ links to hand its time steps to a Lamina generator-node:
 *
 *     cargo build --release -p lamina-c        # makes target/release/liblamina_c.so
 *     cc simulation.c -Iproto/client/c -Ltarget/release -llamina_c -Wl,-rpath,$PWD/target/release
 *
 * Nothing here ends the process, takes its signals, or waits longer than the run's deadline: a node that is dead or stuck
 * costs an error code and a counted lost step, and is tried again by itself. A simulation goes on whatever a call says.
 * One thread at a time may use a connection, of the process that opened it. */
#ifndef LAMINA_H
#define LAMINA_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Types of voxels. */
enum { LAMINA_U8 = 1, LAMINA_U16 = 2, LAMINA_I16 = 3, LAMINA_F16 = 4, LAMINA_F32 = 5, LAMINA_F64 = 6 };

/* What the node does with a step that finds its memory full: drop the oldest that waits, drop this one, or let the
 * simulation wait. */
enum { LAMINA_DROP_OLDEST = 0, LAMINA_DROP_NEWEST = 1, LAMINA_BLOCK = 2 };

/* What became of a call; lamina_error() has the words for those below 0. */
enum {
    LAMINA_ADMITTED = 0,     /* the brick is in */
    LAMINA_DROPPED = 1,      /* the node is full and dropped the step, as the run's policy says */
    LAMINA_INVALID = -1,     /* the arguments cannot be right, whoever listens */
    LAMINA_REFUSED = -2,     /* the node refused; the same again will not help */
    LAMINA_UNREACHABLE = -3, /* the node cannot be reached now */
    LAMINA_DEADLINE = -4,    /* no answer within the deadline */
    LAMINA_FAILED = -5       /* anything else */
};

/* What people who watch ask for: the simulation waits with the next step, goes on, ends as after its last step, or one of its
 * numbers has another value. */
enum { LAMINA_NOTHING = 0, LAMINA_PAUSE = 1, LAMINA_RESUME = 2, LAMINA_STOP = 3, LAMINA_SET = 4 };

/* A number that people may change: what they see it called, its value and the range of values, finite. */
typedef struct {
    const char *name;
    double value, least, most;
} lamina_number;

/* A field: its name, and the type of its voxels. */
typedef struct {
    const char *name;
    int32_t type;
} lamina_field;

/* A run. What is 0 or NULL has its default: lamina_options run = { .name = "blast", ... }. */
typedef struct {
    const char *generator;   /* the generator-node; default http://127.0.0.1:7101. One at https:// asks for credentials */
    const char *name;        /* of the run; needed */
    const char *field;       /* what the scalar is, such as "density"; needed */
    uint64_t dims[3];        /* sample points of the whole grid of all ranks along x, y, z; needed */
    double spacing[3];       /* their distances in world units; default 1 */
    double origin[3];        /* position of the first */
    int32_t type;            /* of the voxels: LAMINA_F32, ...; needed */
    int32_t color_type;      /* of the second field's; needed with one */
    const char *color_field; /* name of a second field that a scene may take its colors from; default none */
    uint32_t rank;           /* of this process, from 0 */
    uint32_t ranks;          /* processes that push their parts of every step; where both are 0, as the MPI launcher's environment
                                says (Open MPI, MPICH, Slurm), else 1; lamina_mpi.h takes them from a communicator */
    int32_t full_policy;     /* default LAMINA_DROP_OLDEST: the simulation never waits for the viewer */
    double deadline_secs;    /* the longest any call may take; default 5 */
    const char *credentials; /* folder of keys that `lamina keys` made; default where the environment variable LAMINA_CREDENTIALS
                                says */
    int32_t steering;        /* not 0: people may ask to pause, to go on, to stop and to change `numbers`, and this rank, which
                                tells the others, asks for that with lamina_steering */
    uint32_t number_count;   /* of the numbers, at most 64 */
    const lamina_number *numbers;
    const lamina_field *more_fields; /* further fields, which every brick carries behind those: people who watch may choose one, or an
                                expression over several. v.x, v.y and v.z are together the vector v */
    uint32_t more_field_count; /* at most 64 */
    const char *shown;       /* what is shown first, a field or an expression such as "magnitude(v)"; default `field` */
    const double *coordinates[3]; /* positions of the sample points along x, y, z, as many as dims, ascending, where they are not even
                                (of cells their centers): steps are shown on as many even ones. Of an axis that is NULL, spacing and
                                origin. Default none */
} lamina_options;

/* The first voxel of a further field's, laid out as the others are, and their type; default the run's. */
typedef struct {
    const void *voxels;
    int32_t type;
} lamina_array;

/* A rank's part of a step, in the simulation's own memory, which is only read, and only during the call. */
typedef struct {
    uint64_t start[3];       /* index of its first sample point in the run's grid, x, y, z */
    uint64_t dims[3];        /* sample points along x, y, z */
    uint64_t strides[3];     /* how far neighbors along x, y, z lie apart in memory, in voxels, forwards; all 0: without gaps,
                                x fastest */
    const void *voxels;      /* the first of them */
    const void *colors;      /* the first of the second field's, laid out alike; or NULL */
    int32_t type;            /* of the voxels; default the run's. Another is refused */
    int32_t color_type;      /* the same of the colors */
    const lamina_array *more; /* one for each of the run's more_fields; or NULL */
} lamina_brick;

/* What somebody asked for. */
typedef struct {
    int32_t what;            /* LAMINA_NOTHING, ... */
    int32_t number;          /* LAMINA_SET: which of the run's numbers, from 0 */
    double value;            /* LAMINA_SET: its new value, within its range */
    char asked_by[64];       /* for people to read */
} lamina_request;

/* What became of a run's bricks. */
typedef struct {
    uint64_t pushed;           /* handed over */
    uint64_t dropped;          /* not taken by the node, by the run's policy */
    uint64_t lost;             /* could not be handed over */
    int64_t run_dropped_steps; /* steps of all ranks dropped or left incomplete so far; -1 if the node did not answer */
} lamina_summary;

/* A connection. */
typedef struct lamina_client lamina_client;

/* Opens a run: 0, and *client is the connection; or an error, and it is NULL, if the options cannot be right or the node
 * refuses them. A node that is not there yet is no error: it is tried again with the next pushes. */
static inline int32_t lamina_connect(const lamina_options *run, lamina_client **client);

/* The same with the size of lamina_options, by which a library of another version knows how much of it there is: what a program does
 * not know yet has its default; what a library does not know yet is refused where it is not 0 or NULL. */
int32_t lamina_connect_sized(const lamina_options *run, size_t size, lamina_client **client);

static inline int32_t lamina_connect(const lamina_options *run, lamina_client **client) {
    return lamina_connect_sized(run, sizeof(lamina_options), client);
}

/* Whether to compute and push `step`: to be asked where its values cost something to have, once a step; what is done between this and
 * the push counts as a cost of watching. 1: yes. 0: the node goes without it, because a contract limits that cost (overhead <= 5%); it is
 * counted as one brick dropped, and is not to be pushed. Below 0, an error: the node is known to be away or refuses the run; the step is
 * lost, and is not to be pushed. Ranks need not get the same answer: where all have a part in computing the values, let them wait for
 * each other first (a wait would count), then ask, then agree (MPI_Allreduce with MPI_MAX); those that did not get 1 do not push. */
int32_t lamina_wants(lamina_client *client, uint64_t step);

/* Tells a number of the step that is pushed next, such as a residual or an energy: it is shown and recorded beside the field, and
 * triggers (diagnostic(NAME) > 1e-3) and alerts can depend on it. `name`: 1 to 60 letters, digits and _, a letter first; a step has at
 * most 64. 0, or an error. Any rank may tell any; of ranks that tell the same one, either counts. */
int32_t lamina_diagnostic(lamina_client *client, const char *name, double value);

/* Hands in this rank's brick of `step`, steps ascending from 0 or more, at simulation time `time`. LAMINA_ADMITTED,
 * LAMINA_DROPPED or, if the step is lost, an error; without a client (NULL) always one. */
int32_t lamina_push(lamina_client *client, uint64_t step, double time, const lamina_brick *brick);

/* The same of `count` bricks of this rank, or of none: a step is whole when all bricks of all ranks are in. */
int32_t lamina_push_bricks(lamina_client *client, uint64_t step, double time, const lamina_brick *bricks, size_t count);

/* Memory for a brick of `dims` sample points, x fastest and without gaps, to compute into: a node on the same host reads it
 * where it is, and nothing is copied. *voxels and, of a run with a second field, *colors (else NULL; `colors` may be NULL), and as
 * many of `more` (may be NULL) as the run has further fields, are the simulation's until it gives them to lamina_push as a brick's,
 * or closes; each is for one push. What they hold at first is of no meaning. Without such a node the memory is the process's own,
 * and is sent. 0, or an error. */
int32_t lamina_buffer(lamina_client *client, const uint64_t dims[3], void **voxels, void **colors, void **more);

/* The oldest request not given out yet; gives what it asks for, LAMINA_NOTHING if there is none, or an error. At once; to be called
 * between steps until there is none. What of it is done is the simulation's choice. A pause whose node is lost is ended by a
 * LAMINA_RESUME. */
int32_t lamina_steering(lamina_client *client, lamina_request *request);

/* Ends this rank's part of the run and frees the connection; NULL is ignored. `summary` may be NULL. */
void lamina_close(lamina_client *client, lamina_summary *summary);

/* Why this thread's last call failed, in words; "" if none did. Valid until its next call that fails. */
const char *lamina_error(void);

#ifdef __cplusplus
}
#endif

#endif
