/* A tree of named nodes with Conduit's C functions and numbers of types, and the part of libcatalyst that opens an implementation: the file
 * libcatalyst-NAME.so in one of CATALYST_IMPLEMENTATION_PATHS, its structure catalyst_api_impl of version 1, all five functions. */
#include "catalyst.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct conduit_datatype {
    conduit_index_t id, elements, stride;
};

struct conduit_node {
    char *name;
    conduit_node **children;
    conduit_index_t count;
    conduit_datatype type;
    void *data;
    int owned;
};

enum { EMPTY = 0, OBJECT = 1, INT32 = 5, INT64 = 6, FLOAT32 = 11, FLOAT64 = 12, TEXT = 13 };

static conduit_node *named(const char *name, size_t length) {
    conduit_node *node = calloc(1, sizeof *node);
    node->name = strndup(name, length);
    return node;
}

conduit_node *conduit_node_create(void) { return named("", 0); }

void conduit_node_destroy(conduit_node *node) {
    for (conduit_index_t n = 0; n < node->count; n++) conduit_node_destroy(node->children[n]);
    if (node->owned) free(node->data);
    free(node->children);
    free(node->name);
    free(node);
}

static conduit_node *walk(conduit_node *node, const char *path, int make) {
    while (node && *path) {
        size_t length = strcspn(path, "/");
        conduit_node *next = NULL;
        for (conduit_index_t n = 0; n < node->count && !next; n++)
            if (strlen(node->children[n]->name) == length && !strncmp(node->children[n]->name, path, length)) next = node->children[n];
        if (!next && make) {
            next = named(path, length);
            node->children = realloc(node->children, sizeof *node->children * (size_t)(node->count + 1));
            node->children[node->count++] = next;
            node->type.id = OBJECT;
        }
        node = next;
        path += length + (path[length] == '/');
    }
    return node;
}

conduit_node *conduit_node_fetch(conduit_node *node, const char *path) { return walk(node, path, 1); }
int conduit_node_has_path(const conduit_node *node, const char *path) { return walk((conduit_node *)node, path, 0) != NULL; }
conduit_index_t conduit_node_number_of_children(conduit_node *node) { return node->count; }
conduit_node *conduit_node_child(conduit_node *node, conduit_index_t index) { return node->children[index]; }
char *conduit_node_name(const conduit_node *node) { return strdup(node->name); }
const conduit_datatype *conduit_node_dtype(const conduit_node *node) { return &node->type; }
conduit_index_t conduit_datatype_id(const conduit_datatype *type) { return type->id; }
conduit_index_t conduit_datatype_number_of_elements(const conduit_datatype *type) { return type->elements; }
conduit_index_t conduit_datatype_stride(const conduit_datatype *type) { return type->stride; }

/* Conduit throws here. */
static void *must(void *found, const char *path) {
    if (!found) {
        fprintf(stderr, "host: no %s\n", path);
        abort();
    }
    return found;
}

conduit_node *conduit_node_fetch_existing(conduit_node *node, const char *path) { return must(walk(node, path, 0), path); }

void *conduit_node_element_ptr(conduit_node *node, conduit_index_t index) { return (char *)node->data + index * node->type.stride; }

char *conduit_node_as_char8_str(conduit_node *node) { return must(node->type.id == TEXT ? node->data : NULL, "text"); }

double conduit_node_fetch_path_as_float64(conduit_node *node, const char *path) {
    conduit_node *found = conduit_node_fetch_existing(node, path);
    return *(double *)must(found->type.id == FLOAT64 ? found->data : NULL, path);
}

static void set(conduit_node *node, const char *path, int id, void *data, conduit_index_t count, conduit_index_t size, int copied) {
    node = walk(node, path, 1);
    if (node->owned) free(node->data);
    node->type = (conduit_datatype){id, count, size};
    node->owned = copied;
    node->data = copied ? memcpy(malloc((size_t)(count * size)), data, (size_t)(count * size)) : data;
}

void conduit_node_set_path_char8_str(conduit_node *node, const char *path, const char *text) {
    set(node, path, TEXT, (void *)text, (conduit_index_t)strlen(text) + 1, 1, 1);
}
void conduit_node_set_path_float64(conduit_node *node, const char *path, double value) { set(node, path, FLOAT64, &value, 1, 8, 1); }
void conduit_node_set_path_int32(conduit_node *node, const char *path, int32_t value) { set(node, path, INT32, &value, 1, 4, 1); }
void conduit_node_set_path_int64(conduit_node *node, const char *path, int64_t value) { set(node, path, INT64, &value, 1, 8, 1); }
void conduit_node_set_path_float64_ptr(conduit_node *node, const char *path, double *values, conduit_index_t count) {
    set(node, path, FLOAT64, values, count, 8, 1);
}
void conduit_node_set_path_float32_ptr(conduit_node *node, const char *path, float *values, conduit_index_t count) {
    set(node, path, FLOAT32, values, count, 4, 1);
}
void conduit_node_set_path_int64_ptr(conduit_node *node, const char *path, int64_t *values, conduit_index_t count) {
    set(node, path, INT64, values, count, 8, 1);
}
void conduit_node_set_path_external_float32_ptr(conduit_node *node, const char *path, float *values, conduit_index_t count) {
    set(node, path, FLOAT32, values, count, 4, 0);
}

static const struct {
    int version;
    int (*initialize)(const conduit_node *);
    int (*execute)(const conduit_node *);
    int (*finalize)(const conduit_node *);
    int (*about)(conduit_node *);
    int (*results)(conduit_node *);
} *implementation;

int catalyst_initialize(const conduit_node *params) {
    const char *name = getenv("CATALYST_IMPLEMENTATION_NAME"), *paths = getenv("CATALYST_IMPLEMENTATION_PATHS");
    for (const char *path = paths; name && path && *path && !implementation;) {
        char file[4096];
        size_t length = strcspn(path, ":");
        snprintf(file, sizeof file, "%.*s/libcatalyst-%s.so", (int)length, path, name);
        void *library = dlopen(file, RTLD_LAZY | RTLD_LOCAL);
        if (library) implementation = dlsym(library, "catalyst_api_impl");
        else fprintf(stderr, "host: %s\n", dlerror());
        path += length + (path[length] == ':');
    }
    if (!implementation || implementation->version != 1 || !implementation->initialize || !implementation->execute ||
        !implementation->finalize || !implementation->about || !implementation->results)
        return 3;
    return implementation->initialize(params);
}

int catalyst_execute(const conduit_node *params) { return implementation->execute(params); }
int catalyst_finalize(const conduit_node *params) { return implementation->finalize(params); }
int catalyst_results(conduit_node *params) { return implementation->results(params); }
