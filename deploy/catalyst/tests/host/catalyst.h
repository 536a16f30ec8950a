/* As much of libcatalyst 2 and of Conduit's C interface as simulation.c and the implementation use, for machines that have neither. */
#ifndef HOST_CATALYST_H
#define HOST_CATALYST_H

#include <stdint.h>

typedef struct conduit_node conduit_node;
typedef struct conduit_datatype conduit_datatype;
typedef int64_t conduit_index_t;

conduit_node *conduit_node_create(void);
void conduit_node_destroy(conduit_node *node);
conduit_node *conduit_node_fetch(conduit_node *node, const char *path);
conduit_node *conduit_node_fetch_existing(conduit_node *node, const char *path);
int conduit_node_has_path(const conduit_node *node, const char *path);
conduit_index_t conduit_node_number_of_children(conduit_node *node);
conduit_node *conduit_node_child(conduit_node *node, conduit_index_t index);
char *conduit_node_name(const conduit_node *node);
const conduit_datatype *conduit_node_dtype(const conduit_node *node);
void *conduit_node_element_ptr(conduit_node *node, conduit_index_t index);
char *conduit_node_as_char8_str(conduit_node *node);
double conduit_node_fetch_path_as_float64(conduit_node *node, const char *path);
void conduit_node_set_path_char8_str(conduit_node *node, const char *path, const char *text);
void conduit_node_set_path_float64(conduit_node *node, const char *path, double value);
void conduit_node_set_path_int32(conduit_node *node, const char *path, int32_t value);
void conduit_node_set_path_int64(conduit_node *node, const char *path, int64_t value);
void conduit_node_set_path_float64_ptr(conduit_node *node, const char *path, double *values, conduit_index_t count);
void conduit_node_set_path_float32_ptr(conduit_node *node, const char *path, float *values, conduit_index_t count);
void conduit_node_set_path_int64_ptr(conduit_node *node, const char *path, int64_t *values, conduit_index_t count);
void conduit_node_set_path_external_float32_ptr(conduit_node *node, const char *path, float *values, conduit_index_t count);
conduit_index_t conduit_datatype_id(const conduit_datatype *type);
conduit_index_t conduit_datatype_number_of_elements(const conduit_datatype *type);
conduit_index_t conduit_datatype_stride(const conduit_datatype *type);

int catalyst_initialize(const conduit_node *params);
int catalyst_execute(const conduit_node *params);
int catalyst_finalize(const conduit_node *params);
int catalyst_results(conduit_node *params);

#endif
