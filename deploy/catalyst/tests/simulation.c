/* A blob that drifts, instrumented for Catalyst 2, or WITH_ASCENT for Ascent, and for nothing else: simulation LAYOUT STEPS RAW_FILE. The
 * ranks of MPI_COMM_WORLD share the 40 x 36 x 32 sample points along z. The last step is written to RAW_FILE by rank 0 (x fastest, single
 * precision). */
#include "cells.h"

#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { NX = 40, NY = 36, NZ = 32 };
static const double H = 0.05, X0 = -1.0, Y0 = -0.9, Z0 = -0.8;

#ifdef WITH_ASCENT
void *ascent_create(void);
void ascent_open(void *, const conduit_node *);
void ascent_publish(void *, const conduit_node *);
void ascent_execute(void *, const conduit_node *);
void ascent_info(void *, conduit_node *);
void ascent_close(void *);
void ascent_destroy(void *);
#define OPTION(name) name
#else
#define OPTION(name) "catalyst/" name
#endif

static double density_at(double x, double y, double z, int step) {
    x -= 0.1 * step;
    return 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z));
}

static float density(int i, int j, int k, int step) { return (float)density_at(X0 + H * i, Y0 + H * j, Z0 + H * k, step); }

/* Point n of an axis, in steps; every second one a quarter off where the axis is uneven, the ends aside. */
static double place(int n, int count, int uneven) { return n + (uneven && n > 0 && n < count - 1 ? 0.5 * (n % 2) - 0.25 : 0.0); }

/* Points `first` to before `beyond` along z, inside of `pad` layers of ghosts on each side of x and y. */
static float *points(int first, int beyond, int pad, int uneven, int step) {
    int nx = NX + 2 * pad, ny = NY + 2 * pad;
    float *values = malloc(sizeof(float) * (size_t)nx * ny * (beyond - first));
    for (int k = first; k < beyond; k++)
        for (int j = -pad; j < NY + pad; j++)
            for (int i = -pad; i < NX + pad; i++) {
                int inside = i >= 0 && j >= 0 && i < NX && j < NY;
                double x = X0 + H * place(i, NX, uneven), y = Y0 + H * place(j, NY, uneven);
                float value = uneven ? (float)density_at(x, y, Z0 + H * k, step) : density(i, j, k, step);
                values[i + pad + (size_t)nx * (j + pad + (size_t)ny * (k - first))] = inside ? value : -1.0f;
            }
    return values;
}

static void set(conduit_node *node, const char *path, double value) { conduit_node_set_path_float64(node, path, value); }

static void axis(conduit_node *mesh, const char *path, int count, double first, int uneven) {
    double *at = malloc(sizeof(double) * (size_t)count);
    for (int n = 0; n < count; n++) at[n] = first + H * place(n, count, uneven);
    conduit_node_set_path_float64_ptr(mesh, path, at, count);
    free(at);
}

/* One domain of a Blueprint mesh over points `first` to before `beyond` along z; of cells where `cells`. */
static void domain(conduit_node *mesh, int first, int beyond, const char *layout, float *values, int pad) {
    int cells = strcmp(layout, "cells") == 0, uneven = strcmp(layout, "uneven") == 0;
    int rectilinear = uneven || strcmp(layout, "rectilinear") == 0;
    int strided = pad > 0;
    /* Of cells whose centers are the sample points. */
    double shift = cells ? -0.5 * H : 0.0;
    if (rectilinear) {
        conduit_node_set_path_char8_str(mesh, "coordsets/coords/type", "rectilinear");
        axis(mesh, "coordsets/coords/values/x", NX, X0, uneven);
        axis(mesh, "coordsets/coords/values/y", NY, Y0, uneven);
        axis(mesh, "coordsets/coords/values/z", beyond - first, Z0 + H * first, 0);
    } else {
        conduit_node_set_path_char8_str(mesh, "coordsets/coords/type", "uniform");
        set(mesh, "coordsets/coords/dims/i", NX + cells);
        set(mesh, "coordsets/coords/dims/j", NY + cells);
        set(mesh, "coordsets/coords/dims/k", beyond - first + cells);
        set(mesh, "coordsets/coords/origin/x", X0 + shift);
        set(mesh, "coordsets/coords/origin/y", Y0 + shift);
        set(mesh, "coordsets/coords/origin/z", Z0 + shift + H * first);
        set(mesh, "coordsets/coords/spacing/dx", H);
        set(mesh, "coordsets/coords/spacing/dy", H);
        set(mesh, "coordsets/coords/spacing/dz", H);
    }
    conduit_node_set_path_char8_str(mesh, "topologies/mesh/type", rectilinear ? "rectilinear" : "uniform");
    conduit_node_set_path_char8_str(mesh, "topologies/mesh/coordset", "coords");
    conduit_node_set_path_char8_str(mesh, "fields/rho/association", cells ? "element" : "vertex");
    conduit_node_set_path_char8_str(mesh, "fields/rho/topology", "mesh");
    long count = (long)(NX + 2 * pad) * (NY + 2 * pad) * (beyond - first);
    conduit_node_set_path_external_float32_ptr(mesh, "fields/rho/values", values, count);
    if (strided) {
        double offsets[3] = {pad, pad, 0}, strides[3] = {1, NX + 2 * pad, (double)(NX + 2 * pad) * (NY + 2 * pad)};
        conduit_node_set_path_float64_ptr(mesh, "fields/rho/offsets", offsets, 3);
        conduit_node_set_path_float64_ptr(mesh, "fields/rho/strides", strides, 3);
    }
}

/* Level 1 of an adaptive mesh: half the spacing, over the middle half along x and y. */
static void finer(conduit_node *mesh, int first, int beyond, int step) {
    int nx = NX + 1, ny = NY + 1, nz = 2 * (beyond - first) - 1;
    double x0 = X0 + H * NX / 4, y0 = Y0 + H * NY / 4, z0 = Z0 + H * first;
    float *values = malloc(sizeof(float) * (size_t)nx * ny * nz);
    for (int k = 0; k < nz; k++)
        for (int j = 0; j < ny; j++)
            for (int i = 0; i < nx; i++)
                values[i + (size_t)nx * (j + (size_t)ny * k)] = (float)density_at(x0 + H / 2 * i, y0 + H / 2 * j, z0 + H / 2 * k, step);
    const char *axes[] = {"coordsets/coords/dims/i", "coordsets/coords/dims/j", "coordsets/coords/dims/k", "coordsets/coords/origin/x",
        "coordsets/coords/origin/y", "coordsets/coords/origin/z", "coordsets/coords/spacing/dx", "coordsets/coords/spacing/dy",
        "coordsets/coords/spacing/dz"};
    double numbers[] = {nx, ny, nz, x0, y0, z0, H / 2, H / 2, H / 2};
    for (int n = 0; n < 9; n++) set(mesh, axes[n], numbers[n]);
    conduit_node_set_path_char8_str(mesh, "coordsets/coords/type", "uniform");
    conduit_node_set_path_char8_str(mesh, "topologies/mesh/type", "uniform");
    conduit_node_set_path_char8_str(mesh, "topologies/mesh/coordset", "coords");
    conduit_node_set_path_char8_str(mesh, "fields/rho/association", "vertex");
    conduit_node_set_path_char8_str(mesh, "fields/rho/topology", "mesh");
    conduit_node_set_path_float32_ptr(mesh, "fields/rho/values", values, (int64_t)nx * ny * nz);
    free(values);
}

/* Marks the outermost cells along x and y as ghosts, and spoils the values at their outer points. */
static void outer_ghosts(conduit_node *mesh, int cx, int cy, int cz) {
    float *marks = calloc((size_t)cx * cy * cz, sizeof(float)), *values = conduit_node_element_ptr(conduit_node_fetch(mesh, "fields/rho/values"), 0);
    for (int k = 0; k < cz; k++)
        for (int j = 0; j < cy; j++)
            for (int i = 0; i < cx; i++) marks[i + (size_t)cx * (j + (size_t)cy * k)] = i == 0 || j == 0 || i == cx - 1 || j == cy - 1;
    for (int k = 0; k <= cz; k++)
        for (int j = 0; j <= cy; j++)
            for (int i = 0; i <= cx; i++)
                if (i == 0 || j == 0 || i == cx || j == cy) values[i + (size_t)(cx + 1) * (j + (size_t)(cy + 1) * k)] = 9.0f;
    conduit_node_set_path_char8_str(mesh, "fields/ascent_ghosts/association", "element");
    conduit_node_set_path_char8_str(mesh, "fields/ascent_ghosts/topology", "mesh");
    conduit_node_set_path_float32_ptr(mesh, "fields/ascent_ghosts/values", marks, (int64_t)cx * cy * cz);
    free(marks);
}

static int of_cells(const char *layout) {
    const char *layouts[] = {"structured", "hexahedra", "tetrahedra", "mixed", "polyhedra", "damaged"};
    for (int n = 0; n < 6; n++)
        if (strcmp(layout, layouts[n]) == 0) return 1;
    return 0;
}

int main(int argc, char **argv) {
    MPI_Init(&argc, &argv);
    if (argc != 4) return fprintf(stderr, "simulation LAYOUT STEPS RAW_FILE\n"), 2;
    const char *layout = argv[1];
    int rank, ranks, steps = atoi(argv[2]), status = 0;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    /* Vertices of a face belong to both of its domains, a halo of two layers to both of its ranks. */
    int cells = strcmp(layout, "cells") == 0, halo = strcmp(layout, "halo") == 0 ? 2 : 0, pad = strcmp(layout, "ghosts") == 0 ? 2 : 0;
    int first = NZ * rank / ranks, beyond = NZ * (rank + 1) / ranks;
    first = first - halo > 0 ? first - halo : 0;
    beyond = beyond + (cells ? 0 : 1) + halo < NZ ? beyond + (cells ? 0 : 1) + halo : NZ;

    conduit_node *params = conduit_node_create();
    conduit_node_set_path_int32(params, OPTION("mpi_comm"), MPI_Comm_c2f(MPI_COMM_WORLD));
    conduit_node_set_path_char8_str(params, OPTION("lamina/name"), layout);
    set(params, OPTION("lamina/steering/viscosity/value"), 0.1);
    set(params, OPTION("lamina/steering/viscosity/least"), 0.0);
    set(params, OPTION("lamina/steering/viscosity/most"), 1.0);
#ifdef WITH_ASCENT
    void *ascent = ascent_create();
    ascent_open(ascent, params);
#else
    status |= catalyst_initialize(params);
#endif
    conduit_node_destroy(params);

#ifdef WITH_ASCENT
    if (strcmp(layout, "nothing") == 0) ascent_publish(ascent, NULL);
#endif
    for (int step = 0; step < steps; step++) {
        /* Of refined, the finer level is there from the second step on, and its coarse cells below are marked, and wrong. */
        int refined = strcmp(layout, "refined") == 0, adaptive = refined || strcmp(layout, "amrmesh") == 0;
        int several = adaptive || strcmp(layout, "multimesh") == 0;
        int middle = several ? (first + beyond) / 2 : beyond, uneven = strcmp(layout, "uneven") == 0;
        float *lower = points(first, several ? middle + 1 : beyond, pad, uneven, step);
        float *upper = several ? points(middle, beyond, 0, 0, step) : NULL;
        conduit_node *run = conduit_node_create(), *data = conduit_node_fetch(run, "catalyst/channels/grid/data");
        conduit_node_set_path_int64(run, "catalyst/state/timestep", step);
        set(run, "catalyst/state/time", 0.5 * step);
        set(run, "catalyst/state/diagnostics/residual", 0.25 * step);
        conduit_node_set_path_char8_str(run, "catalyst/channels/grid/type", adaptive ? "amrmesh" : several ? layout : "mesh");
        if (of_cells(layout)) {
            struct box box = {{NX, NY, beyond - first}, first, {X0, Y0, Z0 + H * first}, H};
            cell_mesh(data, layout, box, density_at, step);
            if (strcmp(layout, "damaged") == 0) {
                int64_t beyond_all[8] = {0, 1, 2, 3, -4, INT64_MAX, 1 << 30, 7};
                if (rank == 1) conduit_node_set_path_char8_str(data, "topologies/mesh/elements/shape", "tri");
                if (rank == 2) conduit_node_set_path_int64_ptr(data, "topologies/mesh/elements/connectivity", beyond_all, 8);
            }
        } else if (!several) {
            domain(data, first, beyond, layout, lower, pad);
        } else {
            domain(conduit_node_fetch(data, "lower"), first, middle + 1, layout, lower, 0);
            domain(conduit_node_fetch(data, "upper"), middle, beyond, layout, upper, 0);
            if (adaptive) {
                conduit_node_set_path_int64(data, "lower/state/level", 0);
                conduit_node_set_path_int64(data, "upper/state/level", 0);
                if (!refined || step > 0) {
                    finer(conduit_node_fetch(data, "finer"), first, beyond, step);
                    conduit_node_set_path_int64(data, "finer/state/level", 1);
                    if (refined) outer_ghosts(conduit_node_fetch(data, "finer"), NX, NY, 2 * (beyond - first) - 2);
                }
            }
        }
#ifdef WITH_ASCENT
        conduit_node *mesh = several ? conduit_node_fetch(data, "lower") : data;
        conduit_node_set_path_int64(mesh, "state/cycle", step);
        set(mesh, "state/time", 0.5 * step);
        set(mesh, "state/diagnostics/residual", 0.25 * step);
        ascent_publish(ascent, data);
        ascent_execute(ascent, run);
#else
        status |= catalyst_execute(run);
#endif
        conduit_node_destroy(run);
        free(lower);
        free(upper);
        usleep(250000);
    }
    conduit_node *results = conduit_node_create();
#ifdef WITH_ASCENT
    ascent_info(ascent, results);
#else
    status |= catalyst_results(results);
#endif
    if (rank == 0) {
        if (conduit_node_has_path(results, "lamina/steering/numbers/viscosity"))
            printf("viscosity %g\n", conduit_node_fetch_path_as_float64(results, "lamina/steering/numbers/viscosity"));
        float *all = points(0, NZ, 0, 0, steps - 1);
        FILE *file = fopen(argv[3], "wb");
        if (!file || fwrite(all, sizeof(float), NX * NY * NZ, file) != NX * NY * NZ || fclose(file)) return 3;
        free(all);
    }
    conduit_node_destroy(results);
#ifdef WITH_ASCENT
    ascent_close(ascent);
    ascent_destroy(ascent);
#else
    conduit_node *last = conduit_node_create();
    status |= catalyst_finalize(last);
    conduit_node_destroy(last);
#endif
    MPI_Finalize();
    printf("rank %d: statuses %d\n", rank, status);
    return status;
}
