/* Approximate minimum degree: an order of elimination with little fill.
 *
 * P. R. Amestoy, T. A. Davis, I. S. Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix
 * Anal. Appl. 17 (1996). The graph of what remains is kept as a quotient graph: an eliminated vertex is an
 * element, the list of the vertices that it has made neighbours of each other.
 */
#include <stdlib.h>

#include "graph.h"

enum { VERTEX, ELEMENT, GONE };

typedef struct {
  int32_t n;
  int64_t *start;                     /* where the list of a vertex or element begins */
  int32_t *list, *length, *elements;  /* a vertex lists elements (so many) before vertices */
  int64_t free, size;
  int32_t *weight;                    /* rows in a vertex, 0 of what is gone, negative in the new element */
  int32_t *degree;                    /* approximate, in rows; of an element its rows */
  int32_t *head, *next, *last;        /* vertices by degree, doubly linked */
  int32_t *merged, *tail;             /* vertices that are eliminated together, linked */
  int64_t *stamp, now, rows;          /* stamps lie below now + rows + 1 */
  uint8_t *kind;
} Quotient;

static void unlink_degree(Quotient *q, int32_t i) {
  if (q->last[i] >= 0) q->next[q->last[i]] = q->next[i];
  else q->head[q->degree[i]] = q->next[i];
  if (q->next[i] >= 0) q->last[q->next[i]] = q->last[i];
}

static void link_degree(Quotient *q, int32_t i) {
  const int32_t first = q->head[q->degree[i]];
  q->next[i] = first, q->last[i] = -1, q->head[q->degree[i]] = i;
  if (first >= 0) q->last[first] = i;
}

/* Eliminate j together with i. */
static void merge(Quotient *q, int32_t i, int32_t j) {
  q->merged[q->tail[i]] = j, q->tail[i] = q->tail[j];
  q->kind[j] = GONE, q->weight[j] = 0;
}

/* Move all lists to the beginning of the memory. */
static void compact(Quotient *q) {
  /* The first number of each list changes places with the name of its owner. */
  for (int32_t i = 0; i < q->n; i++)
    if (q->kind[i] != GONE && q->length[i]) {
      const int64_t at = q->start[i];
      q->start[i] = q->list[at], q->list[at] = -i - 1;
    }
  int64_t to = 0;
  for (int64_t from = 0; from < q->free;) {
    if (q->list[from] >= 0) {
      from++;
      continue;
    }
    const int32_t i = -q->list[from] - 1;
    q->list[to] = (int32_t)q->start[i], q->start[i] = to;
    for (int32_t k = 1; k < q->length[i]; k++) q->list[to + k] = q->list[from + k];
    to += q->length[i], from += q->length[i];
  }
  q->free = to;
}

/* Make p an element: its list is that of all vertices it is joined to, by itself or by its elements. */
static int32_t eliminated(Quotient *q, int32_t p) {
  int64_t room = q->length[p];
  for (int32_t k = 0; k < q->elements[p]; k++) room += q->length[q->list[q->start[p] + k]];
  if (room > q->n) room = q->n;
  if (q->free + room > q->size) compact(q);
  const int64_t begin = q->free;
  int32_t rows = 0;
  const int32_t own = q->weight[p];
  q->weight[p] = -own;
  for (int32_t k = 0; k <= q->elements[p]; k++) {
    const int last = k == q->elements[p];
    const int32_t e = last ? p : q->list[q->start[p] + k];
    const int64_t from = q->start[e] + (last ? q->elements[p] : 0), end = q->start[e] + q->length[e];
    for (int64_t at = from; at < end; at++) {
      const int32_t i = q->list[at];
      if (q->weight[i] <= 0) continue;
      unlink_degree(q, i);
      rows += q->weight[i], q->weight[i] = -q->weight[i];
      q->list[q->free++] = i;
    }
    if (!last) q->kind[e] = GONE;
  }
  q->kind[p] = ELEMENT, q->weight[p] = 0;
  q->start[p] = begin, q->length[p] = (int32_t)(q->free - begin), q->degree[p] = rows;
  return own;
}

/* Bring the lists and degrees of the element's vertices up to date; return the rows eliminated with it. */
static int32_t updated(Quotient *q, int32_t p, int32_t *bucket, int32_t *chain, uint32_t *hash) {
  const int64_t begin = q->start[p], end = begin + q->length[p];
  int32_t taken = 0;
  for (int64_t at = begin; at < end; at++) {
    const int32_t i = q->list[at], rows = -q->weight[i];
    for (int32_t k = 0; k < q->elements[i]; k++) {
      const int32_t e = q->list[q->start[i] + k];
      if (q->kind[e] != ELEMENT) continue;
      if (q->stamp[e] < q->now) q->stamp[e] = q->now + q->degree[e];
      q->stamp[e] -= rows; /* what remains above `now`: its rows outside the new element */
    }
  }
  for (int64_t at = begin; at < end; at++) {
    const int32_t i = q->list[at];
    const int64_t from = q->start[i];
    int64_t to = from;
    int64_t outside = 0;
    uint32_t sum = (uint32_t)p;
    for (int32_t k = 0; k < q->elements[i]; k++) {
      const int32_t e = q->list[from + k];
      if (q->kind[e] != ELEMENT) continue;
      const int64_t rest = q->stamp[e] - q->now;
      if (rest == 0) {
        q->kind[e] = GONE; /* it lies within the new one */
        continue;
      }
      outside += rest, sum += (uint32_t)e, q->list[to++] = e;
    }
    const int32_t kept = (int32_t)(to - from);
    int64_t first_vertex = to;
    for (int64_t k = from + q->elements[i]; k < from + q->length[i]; k++) {
      const int32_t j = q->list[k];
      if (q->weight[j] <= 0) continue;
      outside += q->weight[j], sum += (uint32_t)j, q->list[to++] = j;
    }
    if (to == from) { /* nothing outside: it is eliminated with p */
      taken -= q->weight[i];
      q->degree[p] += q->weight[i];
      merge(q, p, i);
      continue;
    }
    /* The new element comes first: there is room, as an element or p itself has gone from the list. */
    if (first_vertex < to) q->list[to] = q->list[first_vertex];
    if (from < first_vertex) q->list[first_vertex] = q->list[from];
    q->list[from] = p;
    q->elements[i] = kept + 1, q->length[i] = (int32_t)(to - from) + 1;
    if (outside < q->degree[i]) q->degree[i] = (int32_t)outside;
    hash[i] = sum % (uint32_t)q->n;
    chain[i] = bucket[hash[i]], bucket[hash[i]] = i;
  }
  q->now += q->rows + 1;
  return taken;
}

/* Merge vertices of the element that have the same neighbours. */
static void joined(Quotient *q, int32_t p, int32_t *bucket, int32_t *chain, const uint32_t *hash) {
  const int64_t begin = q->start[p], end = begin + q->length[p];
  for (int64_t at = begin; at < end; at++) {
    if (q->weight[q->list[at]] == 0) continue;
    int32_t i = bucket[hash[q->list[at]]];
    bucket[hash[q->list[at]]] = -1;
    for (; i >= 0 && chain[i] >= 0; i = chain[i]) {
      q->now++;
      for (int32_t k = 0; k < q->length[i]; k++) q->stamp[q->list[q->start[i] + k]] = q->now;
      for (int32_t before = i, j = chain[i]; j >= 0; j = chain[j]) {
        int same = q->length[j] == q->length[i] && q->elements[j] == q->elements[i];
        for (int32_t k = 0; same && k < q->length[j]; k++) same = q->stamp[q->list[q->start[j] + k]] == q->now;
        if (!same) {
          before = j;
          continue;
        }
        q->weight[i] += q->weight[j];
        merge(q, i, j);
        chain[before] = chain[j];
      }
    }
  }
  q->now++;
}

/* Write an order of elimination of the graph's vertices, whose rows `weight` counts; 0 if there is no memory.
 * Lists of neighbours are without the vertex itself. */
int minimum_degree(const Graph *graph, int32_t *order) {
  const int32_t n = graph->n;
  Quotient q = {.n = n, .size = graph->start[n] + graph->start[n] / 4 + 4 * (int64_t)n + 16, .now = 1};
  int32_t total = 0;
  for (int32_t i = 0; i < n; i++) total += graph->weight[i];
  q.rows = total;
  const size_t count = (size_t)n + 1;
  int32_t *memory = malloc((11 * count + (size_t)total + 2) * sizeof *memory + count);
  q.list = malloc((size_t)q.size * sizeof *q.list);
  q.start = malloc(2 * count * sizeof *q.start);
  const int there = memory && q.list && q.start;
  if (there) {
    int32_t **parts[] = {&q.length, &q.elements, &q.weight, &q.degree, &q.next, &q.last, &q.merged, &q.tail};
    int32_t *at = memory;
    for (size_t k = 0; k < sizeof parts / sizeof *parts; k++, at += count) *parts[k] = at;
    int32_t *bucket = at, *chain = at + count;
    uint32_t *hash = (uint32_t *)(at + 2 * count);
    q.head = at + 3 * count, q.kind = (uint8_t *)(q.head + total + 1);
    q.stamp = q.start + count;
    memcpy(q.list, graph->neighbours, (size_t)graph->start[n] * sizeof *q.list);
    q.free = graph->start[n];
    for (int32_t d = 0; d <= total; d++) q.head[d] = -1;
    for (int32_t i = 0; i < n; i++) {
      q.start[i] = graph->start[i], q.length[i] = (int32_t)(graph->start[i + 1] - graph->start[i]);
      q.elements[i] = 0, q.weight[i] = graph->weight[i], q.kind[i] = VERTEX, q.stamp[i] = 0;
      q.merged[i] = -1, q.tail[i] = i, bucket[i] = -1;
      q.degree[i] = 0;
      for (int64_t k = graph->start[i]; k < graph->start[i + 1]; k++)
        q.degree[i] += graph->weight[graph->neighbours[k]];
      link_degree(&q, i);
    }
    int32_t left = total, written = 0;
    for (int32_t least = 0; left > 0;) {
      while (q.head[least] < 0) least++;
      const int32_t p = q.head[least];
      unlink_degree(&q, p);
      left -= eliminated(&q, p);
      left -= updated(&q, p, bucket, chain, hash);
      joined(&q, p, bucket, chain, hash);
      /* Restore the weights, and enter the vertices by their new degrees. */
      int64_t to = q.start[p];
      const int64_t end = to + q.length[p];
      for (int64_t at_list = to; at_list < end; at_list++) {
        const int32_t i = q.list[at_list];
        if (q.weight[i] == 0) continue;
        const int32_t rows = q.weight[i] = -q.weight[i];
        int64_t degree = (int64_t)q.degree[i] + q.degree[p] - rows;
        if (degree > left - rows) degree = left - rows;
        q.degree[i] = (int32_t)(degree < 0 ? 0 : degree);
        if (q.degree[i] < least) least = q.degree[i];
        link_degree(&q, i);
        q.list[to++] = i;
      }
      q.length[p] = (int32_t)(to - q.start[p]);
      if (q.length[p] == 0) q.kind[p] = GONE;
      q.free = to;
      for (int32_t i = p; i >= 0; i = q.merged[i]) order[written++] = i;
    }
  }
  free(memory), free(q.list), free(q.start);
  return there;
}
