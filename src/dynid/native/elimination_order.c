/* An order of elimination for the rows of a sparse symmetric matrix. */
#include <stdlib.h>

#include "graph.h"

/* Rows with the same entries, as those of one node are, become one vertex. Write the vertex of each row;
 * return their number. `table` has room for 2 n numbers. */
static int32_t vertices(int64_t n, const int64_t *starts, const int32_t *indices, int32_t *vertex, int32_t *table) {
  int32_t *head = table, *next = table + n, found = 0;
  for (int64_t i = 0; i < n; i++) head[i] = -1;
  for (int32_t i = 0; i < n; i++) {
    const int64_t length = starts[i + 1] - starts[i];
    uint64_t hash = (uint64_t)length;
    int own = 0;
    for (int64_t k = starts[i]; k < starts[i + 1]; k++) {
      hash = hash * 0x9E3779B97F4A7C15u + (uint64_t)indices[k];
      own |= indices[k] == i;
    }
    const int64_t slot = (int64_t)((hash >> 20) % (uint64_t)n);
    int32_t same = own ? head[slot] : -1;
    while (same >= 0 && !(starts[same + 1] - starts[same] == length &&
                          !memcmp(indices + starts[same], indices + starts[i], (size_t)length * sizeof *indices)))
      same = next[same];
    if (same >= 0) vertex[i] = vertex[same];
    else {
      vertex[i] = found++;
      if (own) next[i] = head[slot], head[slot] = i;
    }
  }
  return found;
}

/* Write an order of the rows, by nested dissection with so many attempts, or by minimum degree (0). Return the
 * neighbours of all vertices in the graph, and one; 0 if there is no memory. Indices ascend in each column. */
int64_t elimination_order(int64_t n, const int64_t *starts, const int32_t *indices, int attempts,
                          int32_t *order) {
  const size_t size = (size_t)n + 1;
  int32_t *memory = malloc(6 * size * sizeof *memory);
  Graph graph = {0};
  int done = 0;
  int64_t edges = 0;
  if (!memory) return 0;
  int32_t *vertex = memory, *by_vertex = memory + 4 * size, *mark = memory + 5 * size;
  graph.weight = memory + 3 * size;
  graph.n = vertices(n, starts, indices, vertex, memory + size);
  int32_t *row_start = memory + size, *vertex_order = memory + 2 * size;
  graph.start = calloc((size_t)graph.n + 2, sizeof *graph.start);
  graph.neighbours = malloc((size_t)(starts[n] + 1) * sizeof *graph.neighbours);
  if (graph.start && graph.neighbours) {
    for (int32_t v = 0; v <= graph.n; v++) row_start[v] = 0, mark[v] = -1;
    for (int64_t i = 0; i < n; i++) row_start[vertex[i] + 1]++;
    for (int32_t v = 0; v < graph.n; v++) graph.weight[v] = row_start[v + 1], row_start[v + 1] += row_start[v];
    for (int32_t i = 0; i < n; i++) by_vertex[row_start[vertex[i]]++] = i;
    for (int32_t v = graph.n; v > 0; v--) row_start[v] = row_start[v - 1];
    row_start[0] = 0;
    int64_t to = 0;
    for (int32_t v = 0; v < graph.n; v++) {
      const int32_t i = by_vertex[row_start[v]];
      mark[v] = v;
      for (int64_t k = starts[i]; k < starts[i + 1]; k++) {
        const int32_t other = vertex[indices[k]];
        if (mark[other] != v) mark[other] = v, graph.neighbours[to++] = other;
      }
      graph.start[v + 1] = to;
    }
    done = attempts ? nested_dissection(&graph, attempts, vertex_order) : minimum_degree(&graph, vertex_order);
    edges = to + 1;
    int32_t written = 0;
    for (int32_t v = 0; done && v < graph.n; v++)
      for (int32_t k = row_start[vertex_order[v]]; k < row_start[vertex_order[v]] + graph.weight[vertex_order[v]]; k++)
        order[written++] = by_vertex[k];
  }
  free(memory), free(graph.start), free(graph.neighbours);
  return done ? edges : 0;
}
