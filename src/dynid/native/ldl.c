/* Factors P A P^T = L D L^T of a sparse symmetric matrix, by supernodes; see `dynid.structure.factorisation`.
 *
 * Pivots are taken on the diagonal in the order that keeps the fill small; whoever calls checks them, and the
 * solutions. Columns with the same rows below form a supernode, a dense panel; it takes what the panels
 * before it contribute, and is then factorised (E. G. Ng, B. W. Peyton, "Block sparse Cholesky algorithms
 * on advanced uniprocessor computers", SIAM J. Sci. Comput. 14 (1993)).
 */
#include <math.h>
#include <stdlib.h>

#include "graph.h"

/* Products of a factorisation, for each edge of the graph, from which on an order is also looked for by nested
 * dissection, whose time is about that of the first; and from which on the best of several separators is taken. */
static const double DISSECTED = 5e3, THOROUGH = 3e5;

enum { WIDEST = 128, DOWN = 8, ACROSS = 4, SEVERAL = 4, UNSYMMETRIC = -1 };

typedef struct {
  int64_t n, panels, numbers, longest;
  int32_t *order, *place;  /* the matrix's row of a place in the order, and the other way round */
  int32_t *first, *panel;  /* of a panel its first column, of a column its panel */
  int64_t *row_start, *start;
  int32_t *rows;           /* of each panel, its own columns first, ascending */
  double *L, *D;           /* panels by columns; unit diagonals, and what stands above them, are not read */
} Factors;

ENTRY int64_t dynid_ldl_free(int64_t handle) {
  Factors *f = (Factors *)handle;
  if (!f) return 0;
  free(f->order), free(f->place), free(f->first), free(f->panel);
  free(f->row_start), free(f->start), free(f->rows), free(f->L), free(f->D);
  free(f);
  return 0;
}

/* Write the parents in the elimination tree, of places in the order (-1: none). */
static void tree(const Factors *f, const int64_t *starts, const int32_t *indices, int32_t *parent,
                 int32_t *ancestor) {
  for (int32_t i = 0; i < f->n; i++) {
    parent[i] = ancestor[i] = -1;
    const int32_t column = f->order[i];
    for (int64_t k = starts[column]; k < starts[column + 1]; k++)
      for (int32_t j = f->place[indices[k]], up; j != -1 && j < i; j = up) {
        up = ancestor[j], ancestor[j] = i;
        if (up == -1) parent[j] = i;
      }
  }
}

/* Put the order into that of a walk through the tree, children before parents; `work` has 3 n places. */
static void walk(Factors *f, int32_t *parent, int32_t *work) {
  const int32_t n = (int32_t)f->n;
  int32_t *child = work, *sibling = work + n, *stack = work + 2 * (int64_t)n, *fresh = f->place;
  for (int32_t i = 0; i < n; i++) child[i] = -1;
  for (int32_t i = n - 1; i >= 0; i--)
    if (parent[i] >= 0) sibling[i] = child[parent[i]], child[parent[i]] = i;
  int32_t done = 0;
  for (int32_t root = 0; root < n; root++) {
    if (parent[root] >= 0) continue;
    int32_t height = 0;
    stack[0] = root;
    while (height >= 0) {
      const int32_t i = stack[height], c = child[i];
      if (c >= 0) child[i] = sibling[c], stack[++height] = c;
      else fresh[i] = done++, height--;
    }
  }
  for (int32_t i = 0; i < n; i++) child[fresh[i]] = f->order[i];
  for (int32_t i = 0; i < n; i++) sibling[fresh[i]] = parent[i] < 0 ? -1 : fresh[parent[i]];
  memcpy(f->order, child, (size_t)n * sizeof *child), memcpy(parent, sibling, (size_t)n * sizeof *parent);
  for (int32_t i = 0; i < n; i++) f->place[f->order[i]] = i;
}

/* Write the numbers of entries in the columns of L, the diagonal included. */
static void count(const Factors *f, const int64_t *starts, const int32_t *indices, const int32_t *parent,
                  int32_t *counts, int32_t *mark) {
  for (int32_t i = 0; i < f->n; i++) counts[i] = 1, mark[i] = -1;
  for (int32_t i = 0; i < f->n; i++) {
    const int32_t column = f->order[i];
    mark[i] = i;
    for (int64_t k = starts[column]; k < starts[column + 1]; k++)
      for (int32_t j = f->place[indices[k]]; j < i && mark[j] != i; j = parent[j]) counts[j]++, mark[j] = i;
  }
}

/* Divide the columns into panels: columns with the same rows below, and those where that adds few zeros. */
static int divide(Factors *f, const int32_t *parent, const int32_t *counts) {
  const int32_t n = (int32_t)f->n;
  int32_t *top = malloc(3 * ((size_t)n + 1) * sizeof *top), *width = top + n + 1, *length = width + n + 1;
  int64_t *zeros = malloc(((size_t)n + 1) * sizeof *zeros);
  if (!top || !zeros) {
    free(top), free(zeros);
    return 0;
  }
  int32_t groups = 0;
  for (int32_t j = 0; j < n; j++) {
    if (!j || parent[j - 1] != j || counts[j - 1] != counts[j] + 1) top[groups++] = j;
  }
  top[groups] = n;
  for (int32_t g = 0; g < groups; g++) width[g] = top[g + 1] - top[g], length[g] = counts[top[g]], zeros[g] = 0;
  /* From the last on, take the panel before where it is a child of the one behind it. */
  for (int32_t g = groups - 2, behind = groups - 1; g >= 0; g--) {
    const int64_t own = width[g], other = width[behind], rows = own + length[behind];
    const int64_t more = zeros[g] + zeros[behind] + own * (rows - length[g]);
    const int64_t all = (own + other) * rows;
    const int few = own + other <= 4 || (own + other <= 16 && more * 5 < all * 4) ||
                    (own + other <= 48 && more * 10 < all) || more * 20 < all;
    if (parent[top[g + 1] - 1] == top[g + 1] && few) {
      width[g] = (int32_t)(own + other), length[g] = (int32_t)rows, zeros[g] = more, width[behind] = 0;
    }
    behind = g;
  }
  int64_t panels = 0;
  for (int32_t g = 0; g < groups; g++) panels += (width[g] + WIDEST - 1) / WIDEST;
  f->panels = panels;
  f->first = malloc(((size_t)panels + 1) * sizeof *f->first);
  f->panel = malloc(((size_t)n + 1) * sizeof *f->panel);
  f->row_start = calloc((size_t)panels + 2, sizeof *f->row_start);
  f->start = calloc((size_t)panels + 2, sizeof *f->start);
  const int there = f->first && f->panel && f->row_start && f->start;
  if (there) {
    int64_t s = 0;
    for (int32_t g = 0; g < groups; g++) {
      const int32_t parts = (width[g] + WIDEST - 1) / WIDEST;
      for (int32_t part = 0; part < parts; part++)
        f->first[s++] = top[g] + (int32_t)((int64_t)width[g] * part / parts);
    }
    f->first[panels] = n;
    for (s = 0; s < panels; s++)
      for (int32_t j = f->first[s]; j < f->first[s + 1]; j++) f->panel[j] = (int32_t)s;
  }
  free(top), free(zeros);
  return there;
}

/* Write the rows of the panels (`fill` != 0), or count them in row_start[s + 1]. */
static void rows_of_panels(Factors *f, const int64_t *starts, const int32_t *indices, const int32_t *parent,
                           int64_t *at, int32_t *mark, int fill) {
  for (int64_t s = 0; s < f->panels; s++) mark[s] = -1, at[s] = fill ? f->row_start[s] : 0;
  for (int32_t i = 0; i < f->n; i++) {
    const int32_t column = f->order[i], own = f->panel[i];
    if (mark[own] != i) {
      mark[own] = i;
      if (fill) f->rows[at[own]] = i;
      at[own]++;
    }
    for (int64_t k = starts[column]; k < starts[column + 1]; k++) {
      const int32_t j = f->place[indices[k]];
      if (j >= i) continue;
      for (int32_t s = f->panel[j]; s < own && mark[s] != i;) {
        mark[s] = i;
        if (fill) f->rows[at[s]] = i;
        at[s]++;
        const int32_t up = parent[f->first[s + 1] - 1];
        if (up < 0 || up > i) break;
        s = f->panel[up];
      }
    }
  }
  if (!fill)
    for (int64_t s = 0; s < f->panels; s++) f->row_start[s + 1] = f->row_start[s] + at[s];
}

/* Put the order into that of a walk through its elimination tree, whose parents it writes, and the entries of
 * the columns; return the products that a factorisation takes. `mark` has room for 2 n numbers. */
static double analysed(Factors *f, const int64_t *starts, const int32_t *indices, int32_t *parent, int32_t *counts,
                       int32_t *mark) {
  for (int32_t i = 0; i < f->n; i++) f->place[f->order[i]] = i;
  tree(f, starts, indices, parent, counts);
  walk(f, parent, counts);
  count(f, starts, indices, parent, counts, mark);
  double products = 0.0;
  for (int32_t i = 0; i < f->n; i++) products += (double)counts[i] * counts[i];
  return products;
}

/* Analyse the pattern of a matrix (all of it, by columns), in an order of its rows or, without one, by minimum
 * degree, or nested dissection if that is better; return what `dynid_ldl_factorise` takes. */
ENTRY int64_t dynid_ldl_analyse(int64_t n, const int64_t *starts, const int32_t *indices, const int32_t *order) {
  Factors *f = calloc(1, sizeof *f);
  const size_t size = (size_t)n + 1;
  int64_t edges = 0;
  int32_t *work = malloc(6 * size * sizeof *work);
  if (!f || !work) goto fail;
  f->n = n;
  f->order = malloc(size * sizeof *f->order), f->place = malloc(size * sizeof *f->place);
  f->D = malloc(size * sizeof *f->D);
  if (!f->order || !f->place || !f->D) goto fail;
  int32_t *parent = work, *counts = work + size, *mark = work + 2 * size;
  if (order) memcpy(f->order, order, (size_t)n * sizeof *order);
  else if (!(edges = elimination_order(n, starts, indices, 0, f->order))) goto fail;
  double cost = analysed(f, starts, indices, parent, counts, mark);
  if (!order && cost > DISSECTED * (double)edges) {
    int32_t *known = malloc(size * sizeof *known);
    if (!known) goto fail;
    memcpy(known, f->order, (size_t)n * sizeof *known);
    const int attempts = cost > THOROUGH * (double)edges ? 4 : 1;
    const int there = elimination_order(n, starts, indices, attempts, f->order) > 0;
    if (there && analysed(f, starts, indices, parent, counts, mark) > cost) {
      memcpy(f->order, known, (size_t)n * sizeof *known);
      analysed(f, starts, indices, parent, counts, mark);
    }
    free(known);
    if (!there) goto fail;
  }
  if (!divide(f, parent, counts)) goto fail;
  int64_t *at = (int64_t *)(work + 4 * size); /* two integers a panel */
  rows_of_panels(f, starts, indices, parent, at, mark, 0);
  f->rows = malloc(((size_t)f->row_start[f->panels] + 1) * sizeof *f->rows);
  if (!f->rows) goto fail;
  rows_of_panels(f, starts, indices, parent, at, mark, 1);
  for (int64_t s = 0; s < f->panels; s++) {
    const int64_t rows = f->row_start[s + 1] - f->row_start[s];
    f->start[s + 1] = f->start[s] + rows * (f->first[s + 1] - f->first[s]);
    if (rows > f->longest) f->longest = rows;
  }
  f->numbers = f->start[f->panels];
  free(work);
  return (int64_t)f;
fail:
  free(work);
  dynid_ldl_free((int64_t)f);
  return NO_MEMORY;
}

/* Return the size of the factors, bytes. */
ENTRY int64_t dynid_ldl_bytes(int64_t handle) {
  const Factors *f = (Factors *)handle;
  return 8 * (f->numbers + f->n) + 4 * f->row_start[f->panels];
}

ENTRY int64_t dynid_ldl_order(int64_t handle, int32_t *order) {
  const Factors *f = (Factors *)handle;
  memcpy(order, f->order, (size_t)f->n * sizeof *order);
  return 0;
}

/* Set the sums over k of rows[k][DOWN] x columns[k][ACROSS], both packed. */
INLINE void block(int64_t count, const double *rows, const double *columns, double *out) {
  Aligned sums[ACROSS][DOWN / WIDE];
  _Pragma("GCC unroll 8") for (int c = 0; c < ACROSS; c++)
    _Pragma("GCC unroll 8") for (int r = 0; r < DOWN / WIDE; r++) sums[c][r] = (Aligned){0};
  for (int64_t k = 0; k < count; k++, rows += DOWN, columns += ACROSS) {
    Aligned x[DOWN / WIDE];
    _Pragma("GCC unroll 8") for (int r = 0; r < DOWN / WIDE; r++) x[r] = load(rows + r * WIDE);
    _Pragma("GCC unroll 8") for (int c = 0; c < ACROSS; c++)
      _Pragma("GCC unroll 8") for (int r = 0; r < DOWN / WIDE; r++) sums[c][r] += columns[c] * x[r];
  }
  _Pragma("GCC unroll 8") for (int c = 0; c < ACROSS; c++)
    _Pragma("GCC unroll 8") for (int r = 0; r < DOWN / WIDE; r++) store(out + c * DOWN + r * WIDE, sums[c][r]);
}

/* Subtract L D L_part^T from a panel: L (`rows` rows from `L` on, `count` columns), L_part its first `part`
 * rows. Row i and column j of the product go to place to[i] of the panel's column `to[j]`, or to i and j
 * themselves without `to`. */
INLINE void contribute(const double *L, int64_t ld, int64_t rows, int64_t part, int64_t count, const double *D,
                       const int32_t *to, double *panel, int64_t height, double *packed) {
  double *across = packed + DOWN * WIDEST;
  for (int64_t j = 0; j < part; j += ACROSS) {
    double *out = across + j * count;
    for (int64_t k = 0; k < count; k++)
      for (int c = 0; c < ACROSS; c++) out[k * ACROSS + c] = j + c < part ? D[k] * L[k * ld + j + c] : 0.0;
  }
  for (int64_t i = 0; i < rows; i += DOWN) {
    const int64_t down = rows - i < DOWN ? rows - i : DOWN;
    if (down == DOWN)
      for (int64_t k = 0; k < count; k++) memcpy(packed + k * DOWN, L + k * ld + i, DOWN * sizeof *packed);
    else
      for (int64_t k = 0; k < count; k++)
        for (int r = 0; r < DOWN; r++) packed[k * DOWN + r] = r < down ? L[k * ld + i + r] : 0.0;
    const int straight = down == DOWN && (!to || to[i + DOWN - 1] - to[i] == DOWN - 1);
    const int64_t end = part < i + DOWN ? part : i + DOWN; /* nothing above the diagonal is needed */
    for (int64_t j = 0; j < end; j += ACROSS) {
      double out[ACROSS * DOWN];
      block(count, packed, across + j * count, out);
      const int64_t width = part - j < ACROSS ? part - j : ACROSS;
      for (int64_t c = 0; c < width; c++) {
        double *column = panel + (to ? to[j + c] : j + c) * height;
        if (straight) {
          double *at = column + (to ? to[i] : i);
          for (int r = 0; r < DOWN; r += WIDE) store(at + r, load(at + r) - load(out + c * DOWN + r));
        } else
          for (int64_t r = 0; r < down; r++) column[to ? to[i + r] : i + r] -= out[c * DOWN + r];
      }
    }
  }
}

/* Factorise a panel (height x width) that has its contributions; return the place behind a pivot of zero, or 0. */
static int64_t factorised(double *panel, int64_t height, int64_t width, double *D, double *packed) {
  for (int64_t j = 0; j < width; j += DOWN) {
    const int64_t end = j + DOWN < width ? j + DOWN : width;
    if (j) contribute(panel + j, height, height - j, end - j, j, D, NULL, panel + j * height + j, height, packed);
    for (int64_t c = j; c < end; c++) {
      double *column = panel + c * height;
      const double pivot = column[c];
      if (pivot == 0.0 || !isfinite(pivot)) return c + 1;
      D[c] = pivot;
      for (int64_t other = c + 1; other < end; other++) {
        const double ratio = column[other] / pivot;
        double *target = panel + other * height;
        for (int64_t i = other; i < height; i++) target[i] -= ratio * column[i];
      }
      const double reciprocal = 1.0 / pivot;
      for (int64_t i = c + 1; i < height; i++) column[i] *= reciprocal;
    }
  }
  return 0;
}

/* Compute the factors; return 0, the place in the order behind a pivot that is zero or no number, or -1 where
 * an entry has none on the other side of the diagonal. */
ENTRY int64_t dynid_ldl_factorise(int64_t handle, const int64_t *starts, const int32_t *indices,
                                  const double *data, double *pivots) {
  Factors *f = (Factors *)handle;
  int64_t failed = 0;
  const size_t panels = (size_t)f->panels;
  if (!f->L) f->L = malloc(((size_t)f->numbers + DOWN) * sizeof *f->L);
  int32_t *to = calloc((size_t)f->n + 1, sizeof *to), *places = malloc(((size_t)f->longest + 1) * sizeof *places);
  int32_t *head = malloc((panels + 1) * sizeof *head), *next = malloc((panels + 1) * sizeof *next);
  int64_t *reached = malloc((panels + 1) * sizeof *reached);
  double *packed = malloc((size_t)(WIDEST * (DOWN + WIDEST + ACROSS)) * sizeof *packed);
  if (!f->L || !to || !places || !head || !next || !reached || !packed) {
    failed = NO_MEMORY;
    goto done;
  }
  for (size_t s = 0; s < panels; s++) head[s] = -1;
  for (int64_t s = 0; s < f->panels && !failed; s++) {
    const int32_t first = f->first[s], behind = f->first[s + 1];
    const int32_t *rows = f->rows + f->row_start[s];
    const int64_t height = f->row_start[s + 1] - f->row_start[s], width = behind - first;
    double *panel = f->L + f->start[s];
    memset(panel, 0, (size_t)(height * width) * sizeof *panel);
    for (int64_t i = 0; i < height; i++) to[rows[i]] = (int32_t)i;
    for (int32_t j = first; j < behind; j++) {
      const int32_t column = f->order[j];
      for (int64_t k = starts[column]; k < starts[column + 1]; k++) {
        const int32_t i = f->place[indices[k]];
        if (i < j) continue;
        if (to[i] >= height || rows[to[i]] != i) failed = UNSYMMETRIC;
        else panel[(j - first) * height + to[i]] += data[k];
      }
    }
    for (int32_t d = head[s], after; d >= 0; d = after) {
      after = next[d];
      const int64_t tall = f->row_start[d + 1] - f->row_start[d], from = reached[d];
      const int32_t *its = f->rows + f->row_start[d];
      int64_t end = from;
      for (; end < tall && its[end] < behind; end++) {}
      for (int64_t i = from; i < tall; i++) places[i - from] = to[its[i]];
      contribute(f->L + f->start[d] + from, tall, tall - from, end - from, f->first[d + 1] - f->first[d],
                 f->D + f->first[d], places, panel, height, packed);
      if (end < tall) {
        const int32_t target = f->panel[its[end]];
        reached[d] = end, next[d] = head[target], head[target] = d;
      }
    }
    const int64_t stopped = factorised(panel, height, width, f->D + first, packed);
    if (stopped && !failed) failed = first + stopped;
    if (height > width) {
      const int32_t target = f->panel[rows[width]];
      reached[s] = width, next[s] = head[target], head[target] = (int32_t)s;
    }
  }
  if (!failed)
    for (int64_t j = 0; j < f->n; j++) pivots[f->order[j]] = f->D[j];
done:
  free(to), free(places), free(head), free(next), free(reached), free(packed);
  return failed;
}

/* Add to `out` (rows x several) the product of four columns and x (4 x several). */
INLINE void add_columns(int64_t rows, const double *columns, int64_t height, const double *x, double *out,
                        int several) {
  const double *a = columns, *b = a + height, *c = b + height, *d = c + height;
  if (several == 1) {
    for (int64_t i = 0; i < rows; i++) out[i] += (a[i] * x[0] + b[i] * x[1]) + (c[i] * x[2] + d[i] * x[3]);
    return;
  }
  for (int part = 0; part < several; part += WIDE) {
    const Aligned p = load(x + part), q = load(x + several + part), r = load(x + 2 * several + part),
                  t = load(x + 3 * several + part);
    for (int64_t i = 0; i < rows; i++) {
      double *at = out + i * several + part;
      store(at, load(at) + ((a[i] * p + b[i] * q) + (c[i] * r + d[i] * t)));
    }
  }
}

/* Set `out` (4 x several) to the products of four columns (rows) with x (rows x several). */
INLINE void columns_times(int64_t rows, const double *columns, int64_t height, const double *x, double *out,
                          int several) {
  const double *a = columns, *b = a + height, *c = b + height, *d = c + height;
  if (several == 1) {
    Aligned p = {0}, q = {0}, r = {0}, t = {0};
    int64_t i = 0;
    for (; i + WIDE <= rows; i += WIDE) {
      const Aligned y = load(x + i);
      p += load(a + i) * y, q += load(b + i) * y, r += load(c + i) * y, t += load(d + i) * y;
    }
    out[0] = total(p), out[1] = total(q), out[2] = total(r), out[3] = total(t);
    for (; i < rows; i++) out[0] += a[i] * x[i], out[1] += b[i] * x[i], out[2] += c[i] * x[i], out[3] += d[i] * x[i];
    return;
  }
  for (int part = 0; part < several; part += WIDE) {
    Aligned p = {0}, q = {0}, r = {0}, t = {0};
    for (int64_t i = 0; i < rows; i++) {
      const Aligned y = load(x + i * several + part);
      p += a[i] * y, q += b[i] * y, r += c[i] * y, t += d[i] * y;
    }
    store(out + part, p), store(out + several + part, q);
    store(out + 2 * several + part, r), store(out + 3 * several + part, t);
  }
}

/* Solve with the factors for `several` right-hand sides that stand side by side in y, in the order of the
 * factors; `below` has room for as many of the longest panel. */
INLINE void solved(const Factors *f, double *y, double *below, int several) {
  for (int64_t s = 0; s < f->panels; s++) {
    const int64_t height = f->row_start[s + 1] - f->row_start[s], width = f->first[s + 1] - f->first[s];
    const double *panel = f->L + f->start[s];
    const int32_t *rows = f->rows + f->row_start[s] + width;
    const int64_t rest = height - width;
    double *x = y + (int64_t)f->first[s] * several;
    for (int64_t j = 0; j < width; j++)
      for (int64_t i = j + 1; i < width; i++)
        for (int c = 0; c < several; c++) x[i * several + c] -= panel[j * height + i] * x[j * several + c];
    memset(below, 0, (size_t)(rest * several) * sizeof *below);
    int64_t j = 0;
    for (; j + 4 <= width; j += 4)
      add_columns(rest, panel + j * height + width, height, x + j * several, below, several);
    for (; j < width; j++)
      for (int64_t i = 0; i < rest; i++)
        for (int c = 0; c < several; c++) below[i * several + c] += panel[j * height + width + i] * x[j * several + c];
    for (int64_t i = 0; i < rest; i++)
      for (int c = 0; c < several; c++) y[(int64_t)rows[i] * several + c] -= below[i * several + c];
  }
  for (int64_t s = f->panels - 1; s >= 0; s--) {
    const int64_t height = f->row_start[s + 1] - f->row_start[s], width = f->first[s + 1] - f->first[s];
    const double *panel = f->L + f->start[s];
    const int32_t *rows = f->rows + f->row_start[s] + width;
    const int64_t rest = height - width;
    double *x = y + (int64_t)f->first[s] * several, sums[WIDEST * SEVERAL];
    for (int64_t i = 0; i < rest; i++)
      for (int c = 0; c < several; c++) below[i * several + c] = y[(int64_t)rows[i] * several + c];
    int64_t j = 0;
    for (; j + 4 <= width; j += 4)
      columns_times(rest, panel + j * height + width, height, below, sums + j * several, several);
    for (; j < width; j++)
      for (int c = 0; c < several; c++) {
        double sum = 0.0;
        for (int64_t i = 0; i < rest; i++) sum += panel[j * height + width + i] * below[i * several + c];
        sums[j * several + c] = sum;
      }
    for (j = width - 1; j >= 0; j--) {
      for (int64_t i = j + 1; i < width; i++)
        for (int c = 0; c < several; c++) sums[j * several + c] += panel[j * height + i] * x[i * several + c];
      for (int c = 0; c < several; c++)
        x[j * several + c] = x[j * several + c] / f->D[f->first[s] + j] - sums[j * several + c];
    }
  }
}

/* Solve in place for right-hand sides (n x columns, by rows). */
ENTRY int64_t dynid_ldl_solve(int64_t handle, int64_t columns, double *b) {
  const Factors *f = (Factors *)handle;
  double *y = malloc((size_t)((f->n + f->longest) * SEVERAL + 1) * sizeof *y);
  if (!y) return NO_MEMORY;
  for (int64_t c = 0; c < columns;) {
    const int several = columns - c >= SEVERAL ? SEVERAL : 1;
    for (int64_t i = 0; i < f->n; i++)
      for (int k = 0; k < several; k++) y[i * several + k] = b[f->order[i] * columns + c + k];
    double *below = y + f->n * several;
    if (several == 1) solved(f, y, below, 1);
    else solved(f, y, below, SEVERAL);
    for (int64_t i = 0; i < f->n; i++)
      for (int k = 0; k < several; k++) b[f->order[i] * columns + c + k] = y[i * several + k];
    c += several;
  }
  free(y);
  return 0;
}
