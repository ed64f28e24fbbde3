/* Graphs of sparse symmetric matrices, and orders in which to eliminate their vertices. */
#ifndef DYNID_GRAPH_H
#define DYNID_GRAPH_H

#include "products.h"

/* Vertices 0 … n - 1 with their neighbours; a vertex stands for `weight` rows of the matrix. */
typedef struct {
  int32_t n;
  int64_t *start;
  int32_t *neighbours, *weight, *ties; /* ties of each neighbour (absent: one each) */
} Graph;

int minimum_degree(const Graph *graph, int32_t *order);
int nested_dissection(const Graph *graph, int attempts, int32_t *order);
int64_t elimination_order(int64_t n, const int64_t *starts, const int32_t *indices, int attempts,
                          int32_t *order);

#endif
