/* Nested dissection: an order of elimination in which a separator follows the parts that it divides.
 *
 * Separators are found by multilevel bisection: the graph is coarsened by matching neighbours, divided where
 * it is small, and the separator refined on the way back by moves that may at first enlarge it (C. M. Fiduccia,
 * R. M. Mattheyses, "A linear-time heuristic for improving network partitions", DAC 1982; G. Karypis,
 * V. Kumar, "A fast and high quality multilevel scheme for partitioning irregular graphs", SIAM J. Sci.
 * Comput. 20 (1998)). Small parts are ordered by minimum degree.
 */
#include <stdlib.h>

#include "graph.h"

enum { SMALL = 120, COARSEST = 40, TRIALS = 6, PASSES = 8, CLIMB = 60, LEVELS = 40 };
enum { SEPARATOR = 2 }; /* the sides are 0 and 1 */

static const double LARGEST_SIDE = 0.55; /* of all rows */

static void discard(Graph *g) {
  free(g->start), free(g->neighbours), free(g->weight), free(g->ties);
  *g = (Graph){0};
}

static int reserve(Graph *g, int32_t n, int64_t edges) {
  g->n = n;
  g->start = malloc(((size_t)n + 1) * sizeof *g->start);
  g->neighbours = malloc(((size_t)edges + 1) * sizeof *g->neighbours);
  g->weight = malloc(((size_t)n + 1) * sizeof *g->weight);
  g->ties = malloc(((size_t)edges + 1) * sizeof *g->ties);
  return g->start && g->neighbours && g->weight && g->ties;
}

static uint32_t random_number(uint32_t *state) { return *state = *state * 1664525u + 1013904223u; }

static int64_t rows_of(const Graph *g) {
  int64_t sum = 0;
  for (int32_t i = 0; i < g->n; i++) sum += g->weight[i];
  return sum;
}

/* Write into `coarse` the graph of pairs of neighbours, into `pair` the new vertex of each; 0 without memory.
 * A vertex is paired with the one that most ties join it to, of those that are light. */
static int coarsened(const Graph *g, Graph *coarse, int32_t *pair, uint32_t *seed) {
  const int32_t n = g->n;
  int32_t *mate = malloc(2 * ((size_t)n + 1) * sizeof *mate), *order = mate + n + 1;
  int64_t *mark = malloc(((size_t)n + 1) * sizeof *mark);
  if (!mate || !mark) {
    free(mate), free(mark);
    return 0;
  }
  const int64_t heaviest = 3 * rows_of(g) / (2 * COARSEST) + 1;
  for (int32_t i = 0; i < n; i++) mate[i] = mark[i] = -1, order[i] = i;
  for (int32_t i = n - 1; i > 0; i--) {
    const int32_t j = (int32_t)((random_number(seed) >> 8) % (uint32_t)(i + 1)), was = order[i];
    order[i] = order[j], order[j] = was;
  }
  int32_t count = 0;
  for (int32_t at = 0; at < n; at++) {
    const int32_t i = order[at];
    if (mate[i] >= 0) continue;
    int32_t best = i, strongest = 0;
    for (int64_t k = g->start[i]; k < g->start[i + 1]; k++) {
      const int32_t j = g->neighbours[k];
      if (mate[j] >= 0 || (int64_t)g->weight[i] + g->weight[j] > heaviest) continue;
      const int32_t tie = g->ties ? g->ties[k] : 1;
      if (tie > strongest) best = j, strongest = tie;
    }
    mate[i] = best, mate[best] = i, pair[i] = pair[best] = count++;
  }
  const int there = reserve(coarse, count, g->start[n]);
  if (there) {
    int64_t to = 0;
    int32_t c = 0;
    coarse->start[0] = 0;
    for (int32_t at = 0; at < n; at++) { /* in the order of their numbers */
      const int32_t i = order[at];
      if (pair[i] != c) continue;
      coarse->weight[c] = 0;
      for (int32_t half = 0; half < (mate[i] == i ? 1 : 2); half++) {
        const int32_t own = half ? mate[i] : i;
        coarse->weight[c] += g->weight[own];
        for (int64_t k = g->start[own]; k < g->start[own + 1]; k++) {
          const int32_t other = pair[g->neighbours[k]];
          if (other == c) continue;
          const int32_t tie = g->ties ? g->ties[k] : 1;
          if (mark[other] >= coarse->start[c]) coarse->ties[mark[other]] += tie;
          else coarse->ties[to] = tie, mark[other] = to, coarse->neighbours[to++] = other;
        }
      }
      coarse->start[++c] = to;
    }
  }
  free(mate), free(mark);
  return there;
}

/* A division of a graph, with room for its refinement. */
typedef struct {
  int8_t *side;
  int64_t rows[3];     /* of the sides, and of the separator */
  int64_t *beside[2];  /* of a vertex of the separator the rows of its neighbours on the sides */
  int32_t *separator, *place;
  int32_t count;
  int8_t *moved;
} Division;

static void weigh(const Graph *g, Division *d) {
  d->rows[0] = d->rows[1] = d->rows[2] = 0;
  for (int32_t i = 0; i < g->n; i++) d->rows[d->side[i]] += g->weight[i];
}

/* Take a vertex into the list of the separator, and weigh what is beside it. */
static void enter(const Graph *g, Division *d, int32_t i) {
  d->place[i] = d->count, d->separator[d->count++] = i;
  d->beside[0][i] = d->beside[1][i] = 0;
  for (int64_t k = g->start[i]; k < g->start[i + 1]; k++) {
    const int32_t j = g->neighbours[k];
    if (d->side[j] != SEPARATOR) d->beside[d->side[j]][i] += g->weight[j];
  }
}

/* Move a vertex of the separator to a side; its neighbours on the other come into the separator. Returns how
 * many vertices are in the log then. */
static int32_t move(const Graph *g, Division *d, int32_t v, int side, int32_t *log, int32_t logged) {
  const int other = 1 - side;
  const int32_t last = d->separator[--d->count];
  d->separator[d->place[v]] = last, d->place[last] = d->place[v];
  d->side[v] = (int8_t)side, d->moved[v] = 1, log[logged++] = 2 * v + 1;
  d->rows[2] -= g->weight[v], d->rows[side] += g->weight[v];
  for (int64_t k = g->start[v]; k < g->start[v + 1]; k++) {
    const int32_t j = g->neighbours[k];
    if (d->side[j] == SEPARATOR) d->beside[side][j] += g->weight[v];
  }
  for (int64_t k = g->start[v]; k < g->start[v + 1]; k++) {
    const int32_t u = g->neighbours[k];
    if (d->side[u] != other) continue;
    d->side[u] = SEPARATOR, log[logged++] = 2 * u;
    d->rows[other] -= g->weight[u], d->rows[2] += g->weight[u];
    for (int64_t m = g->start[u]; m < g->start[u + 1]; m++) {
      const int32_t s = g->neighbours[m];
      if (d->side[s] == SEPARATOR) d->beside[other][s] -= g->weight[u];
    }
    enter(g, d, u);
  }
  return logged;
}

/* Refine the separator by passes of moves, each undone behind the best division that it has passed. `log` has
 * room for 2 n + 1 numbers. */
static void refine(const Graph *g, Division *d, int32_t *log) {
  const int64_t all = d->rows[0] + d->rows[1] + d->rows[2], most = (int64_t)(LARGEST_SIDE * (double)all) + 1;
  for (int pass = 0; pass < PASSES; pass++) {
    d->count = 0;
    for (int32_t i = 0; i < g->n; i++) {
      d->moved[i] = 0;
      if (d->side[i] == SEPARATOR) enter(g, d, i);
    }
    int64_t best = d->rows[2];
    int64_t apart = llabs(d->rows[0] - d->rows[1]);
    const int64_t before = best, apart_before = apart;
    int32_t logged = 0, kept = 0;
    for (int32_t idle = 0; idle < CLIMB + d->count / 4;) {
      int32_t chosen = -1;
      int to = 0;
      int64_t gain = INT64_MIN;
      for (int32_t k = 0; k < d->count; k++) {
        const int32_t v = d->separator[k];
        if (d->moved[v]) continue;
        for (int side = 0; side < 2; side++) {
          const int64_t its = d->rows[side] + g->weight[v];
          if (its > most && its > d->rows[1 - side] - d->beside[1 - side][v]) continue;
          /* Ties go to the lighter side. */
          const int64_t value = 2 * (g->weight[v] - d->beside[1 - side][v]) + (d->rows[side] < d->rows[1 - side]);
          if (value > gain) gain = value, chosen = v, to = side;
        }
      }
      if (chosen < 0 || logged + (int32_t)(g->start[chosen + 1] - g->start[chosen]) + 1 > 2 * g->n) break;
      logged = move(g, d, chosen, to, log, logged);
      const int64_t distance = llabs(d->rows[0] - d->rows[1]);
      const int feasible = d->rows[0] <= most && d->rows[1] <= most;
      if (feasible && (d->rows[2] < best || (d->rows[2] == best && distance < apart)))
        best = d->rows[2], apart = distance, kept = logged, idle = 0;
      else idle++;
    }
    /* Undo from the end: a moved vertex returns to the separator, what it had pulled in to its side. */
    while (logged > kept) {
      int32_t first = logged - 1;
      while (!(log[first] & 1)) first--;
      const int32_t v = log[first] >> 1;
      const int8_t other = (int8_t)(1 - d->side[v]);
      for (int32_t k = first + 1; k < logged; k++) d->side[log[k] >> 1] = other;
      d->side[v] = SEPARATOR, logged = first;
    }
    weigh(g, d);
    if (best >= before && apart >= apart_before) break;
  }
}

/* Divide a small graph: grow a side from several vertices, and keep the best after refinement. */
static void divide(const Graph *g, Division *d, int8_t *best, int32_t *log, int32_t *queue, uint32_t *seed) {
  const int64_t all = rows_of(g);
  int64_t least = INT64_MAX;
  for (int trial = 0; trial < TRIALS; trial++) {
    int32_t start = (int32_t)((random_number(seed) >> 8) % (uint32_t)g->n);
    int32_t end = 0;
    for (int walk = 0; walk < 2; walk++) { /* the first ends at a vertex far from the others */
      memset(d->side, 1, (size_t)g->n);
      int64_t grown = 0;
      int32_t head = 0, next = 0;
      end = 0, queue[end++] = start, d->side[start] = 0;
      while (grown * 2 < all || !walk) {
        if (head == end) { /* another component */
          while (next < g->n && d->side[next] == 0) next++;
          if (next == g->n) break;
          d->side[next] = 0, queue[end++] = next;
        }
        const int32_t i = queue[head++];
        grown += g->weight[i];
        start = i;
        for (int64_t k = g->start[i]; k < g->start[i + 1]; k++) {
          const int32_t j = g->neighbours[k];
          if (d->side[j] == 1) d->side[j] = 0, queue[end++] = j;
        }
      }
      for (int32_t k = head; k < end; k++) d->side[queue[k]] = SEPARATOR;
    }
    weigh(g, d);
    refine(g, d, log);
    const int64_t longer = d->rows[0] > d->rows[1] ? d->rows[0] : d->rows[1];
    const int64_t cost = d->rows[2] + (longer > (int64_t)(LARGEST_SIDE * (double)all) + 1 ? all : 0);
    if (cost < least) least = cost, memcpy(best, d->side, (size_t)g->n);
  }
  memcpy(d->side, best, (size_t)g->n);
  weigh(g, d);
}

/* Write the sides of the vertices; return the rows of the separator, -1 without memory. */
static int64_t bisected(const Graph *g, int8_t *side, uint32_t *seed) {
  const size_t n = (size_t)g->n + 1;
  Graph levels[LEVELS];
  int32_t *pairs[LEVELS];
  int depth = 0, there = 1;
  int64_t rows = -1;
  levels[0] = *g;
  while (depth + 1 < LEVELS && levels[depth].n > COARSEST) {
    pairs[depth] = malloc(((size_t)levels[depth].n + 1) * sizeof **pairs);
    levels[depth + 1] = (Graph){0};
    there = pairs[depth] && coarsened(&levels[depth], &levels[depth + 1], pairs[depth], seed);
    depth++;
    if (!there || levels[depth].n > levels[depth - 1].n * 19 / 20) break; /* nothing more to be paired */
  }
  int64_t *wide = malloc(2 * n * sizeof *wide);
  int32_t *memory = malloc(5 * n * sizeof *memory);
  int8_t *bytes = malloc(4 * n);
  there = there && wide && memory && bytes;
  if (there) {
    int8_t *finer = bytes + 3 * n;
    Division d = {.side = bytes, .moved = bytes + n, .beside = {wide, wide + n}, .separator = memory,
                  .place = memory + n};
    int32_t *log = memory + 2 * n, *queue = memory + 4 * n;
    divide(&levels[depth], &d, bytes + 2 * n, log, queue, seed);
    for (int level = depth - 1; level >= 0; level--) {
      for (int32_t i = 0; i < levels[level].n; i++) finer[i] = d.side[pairs[level][i]];
      memcpy(d.side, finer, (size_t)levels[level].n);
      weigh(&levels[level], &d);
      refine(&levels[level], &d, log);
    }
    memcpy(side, d.side, (size_t)g->n);
    rows = d.rows[SEPARATOR];
  }
  for (int level = 0; level < depth; level++) {
    free(pairs[level]);
    discard(&levels[level + 1]);
  }
  free(wide), free(memory), free(bytes);
  return rows;
}

/* Write the part of a graph on one side, and its vertices; `fresh` has room for all vertices. */
static int part_of(const Graph *g, const int8_t *side, int which, Graph *part, int32_t *members, int32_t *fresh) {
  int32_t count = 0;
  int64_t edges = 0;
  for (int32_t i = 0; i < g->n; i++)
    if (side[i] == which) fresh[i] = count, members[count++] = i, edges += g->start[i + 1] - g->start[i];
  if (!reserve(part, count, edges)) return 0;
  free(part->ties), part->ties = NULL;
  int64_t to = 0;
  part->start[0] = 0;
  for (int32_t c = 0; c < count; c++) {
    const int32_t i = members[c];
    part->weight[c] = g->weight[i];
    for (int64_t k = g->start[i]; k < g->start[i + 1]; k++)
      if (side[g->neighbours[k]] == which) part->neighbours[to++] = fresh[g->neighbours[k]];
    part->start[c + 1] = to;
  }
  return 1;
}

static int dissected(const Graph *g, int attempts, int32_t *order, uint32_t *seed) {
  if (g->n <= SMALL) return minimum_degree(g, order);
  const size_t n = (size_t)g->n + 1;
  int8_t *side = malloc(2 * n), *tried = side + n;
  int32_t *members = malloc(2 * n * sizeof *members), *fresh = members + n;
  int64_t least = side && members ? bisected(g, side, seed) : -1;
  for (int attempt = 1; least > 0 && attempt < attempts; attempt++) {
    const int64_t rows = bisected(g, tried, seed);
    if (rows >= 0 && rows < least) least = rows, memcpy(side, tried, (size_t)g->n);
  }
  int there = least >= 0;
  int32_t sides[2] = {0, 0}, written = 0;
  for (int32_t i = 0; there && i < g->n; i++)
    if (side[i] != SEPARATOR) sides[side[i]]++;
  if (there && (!sides[0] || !sides[1])) there = minimum_degree(g, order); /* it has no separator */
  else
    for (int which = 0; there && which < 3; which++) {
      Graph part = {0};
      there = part_of(g, side, which, &part, members, fresh);
      int32_t *own = malloc(((size_t)part.n + 1) * sizeof *own);
      there = there && own;
      if (there && which == SEPARATOR)
        for (int32_t k = 0; k < part.n; k++) own[k] = k;
      else if (there) there = dissected(&part, attempts, own, seed);
      /* `members` is of this call, and holds these vertices still. */
      for (int32_t k = 0; there && k < part.n; k++) order[written++] = members[own[k]];
      free(own), discard(&part);
    }
  free(side), free(members);
  return there;
}

/* Write an order of elimination of the graph's vertices, every separator the best of so many; 0 without memory. */
int nested_dissection(const Graph *graph, int attempts, int32_t *order) {
  uint32_t seed = 1;
  return dissected(graph, attempts, order, &seed);
}
