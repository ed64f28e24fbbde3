/* Roots of det(A + s E) refined on the sparse equations; see `dynid.bondgraph.floating.spectrum`, which does the
 * same. Every factorisation is left-looking with partial pivoting (Gilbert & Peierls 1988). */
#include <math.h>
#include <stdlib.h>

#include "products.h"

#define UNIT 0x1p-53
#define ALLOWANCE 8.0
#define NEXT 64.0 /* allowed for the correction that follows one, over its square by the room */
enum { ITERATIONS = 2, FACTORISATIONS = 4, BESIDE = 4 };
static const double SHIFTS[BESIDE] = {UNIT, 0x1p-40, 0x1p-26, 0x1p-18};

typedef struct {
  double re, im;
} Complex;

INLINE Complex times(Complex a, Complex b) {
  return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}
INLINE Complex conjugate(Complex a) { return (Complex){a.re, -a.im}; }
INLINE double larger_part(Complex a) { return fmax(fabs(a.re), fabs(a.im)); }

INLINE Complex quotient(Complex a, Complex b) { /* Smith 1962 */
  if (fabs(b.re) >= fabs(b.im)) {
    const double r = b.im / b.re, d = b.re + b.im * r;
    return (Complex){(a.re + a.im * r) / d, (a.im - a.re * r) / d};
  }
  const double r = b.re / b.im, d = b.re * r + b.im;
  return (Complex){(a.re * r + a.im) / d, (a.im * r - a.re) / d};
}

typedef struct {
  int64_t *start, *row, length, room;
  Complex *value;
} Columns;

/* The equations of one block, compressed by columns, and the factors P A Q = L U at one s. */
typedef struct {
  int64_t n;
  const int64_t *start, *row, *order; /* of the entries; the columns in the order of elimination */
  const double *constant, *slope, *seed;
  double unit;
  Columns L, U;
  int64_t *place, *stack, *pause, *reached, *mark; /* place: the step at which a row was the pivot, or -1 */
  Complex *work, *x, *y, *pivot; /* the reciprocals of the pivots */
  double *rows, *columns, *peaks;
} Block;

static int grow(Columns *c, int64_t more) {
  if (c->length + more <= c->room) return 0;
  const int64_t room = 2 * c->room + more;
  int64_t *row = realloc(c->row, sizeof(int64_t) * room);
  if (row) c->row = row;
  Complex *value = realloc(c->value, sizeof(Complex) * room);
  if (value) c->value = value;
  if (!row || !value) return 1;
  c->room = room;
  return 0;
}

/* Put the rows that a column reaches through L before `top` of b->reached, in topological order. */
static int64_t reach(Block *b, int64_t column, int64_t step) {
  int64_t top = b->n;
  for (int64_t p = b->start[column]; p < b->start[column + 1]; p++) {
    if (b->mark[b->row[p]] == step) continue;
    int64_t depth = 0;
    b->stack[0] = b->row[p];
    while (depth >= 0) {
      const int64_t row = b->stack[depth], at = b->place[row];
      if (b->mark[row] != step) {
        b->mark[row] = step;
        b->pause[depth] = at < 0 ? 0 : b->L.start[at];
      }
      const int64_t end = at < 0 ? 0 : b->L.start[at + 1];
      int64_t p2 = b->pause[depth];
      while (p2 < end && b->mark[b->L.row[p2]] == step) p2++;
      if (p2 < end) {
        b->pause[depth] = p2 + 1;
        b->stack[++depth] = b->L.row[p2];
      } else {
        b->reached[--top] = row;
        depth--;
      }
    }
  }
  return top;
}

/* Factorise the equilibrated matrix at s. Returns 0, 1 where it is singular, 2 without memory. */
static int factorise(Block *b, Complex s) {
  b->L.length = b->U.length = 0;
  for (int64_t i = 0; i < b->n; i++) b->place[i] = b->mark[i] = -1;
  for (int64_t step = 0; step < b->n; step++) {
    b->L.start[step] = b->L.length;
    b->U.start[step] = b->U.length;
    if (grow(&b->L, b->n) || grow(&b->U, b->n)) return 2;
    const int64_t column = b->order[step], top = reach(b, column, step);
    for (int64_t k = top; k < b->n; k++) b->work[b->reached[k]] = (Complex){0, 0};
    for (int64_t p = b->start[column]; p < b->start[column + 1]; p++) {
      const double scale = b->rows[b->row[p]] * b->columns[column];
      const double re = (b->constant[p] + s.re * b->slope[p]) * scale;
      b->work[b->row[p]] = (Complex){re, s.im * b->slope[p] * scale};
    }
    int64_t chosen = -1;
    double largest = 0;
    for (int64_t k = top; k < b->n; k++) {
      const int64_t row = b->reached[k], at = b->place[row];
      const Complex value = b->work[row];
      if (at >= 0) {
        for (int64_t p = b->L.start[at]; p < b->L.start[at + 1]; p++) {
          Complex *to = b->work + b->L.row[p];
          const Complex part = times(b->L.value[p], value);
          to->re -= part.re, to->im -= part.im;
        }
        b->U.row[b->U.length] = at;
        b->U.value[b->U.length++] = value;
      } else {
        const double size = fabs(value.re) + fabs(value.im);
        if (!(size <= largest)) largest = size, chosen = row; /* nan, too */
      }
    }
    if (chosen < 0 || !isfinite(largest)) return 1;
    b->place[chosen] = step;
    b->pivot[step] = quotient((Complex){1.0, 0.0}, b->work[chosen]);
    for (int64_t k = top; k < b->n; k++) {
      const int64_t row = b->reached[k];
      if (b->place[row] >= 0) continue;
      b->L.row[b->L.length] = row;
      b->L.value[b->L.length++] = times(b->work[row], b->pivot[step]);
    }
    b->L.start[step + 1] = b->L.length;
    b->U.start[step + 1] = b->U.length;
  }
  return 0;
}

static void normalise(int64_t n, Complex *x) {
  double largest = 0;
  for (int64_t i = 0; i < n; i++) largest = fmax(largest, larger_part(x[i]));
  for (int64_t i = 0; i < n; i++) x[i].re /= largest, x[i].im /= largest;
}

/* Solve A x = rhs; both are arrays of the block, and different ones. */
static void solve(const Block *b, const Complex *rhs, Complex *x) {
  Complex *work = b->work; /* by steps */
  for (int64_t i = 0; i < b->n; i++) work[b->place[i]] = rhs[i];
  for (int64_t step = 0; step < b->n; step++)
    for (int64_t p = b->L.start[step]; p < b->L.start[step + 1]; p++) {
      const Complex part = times(b->L.value[p], work[step]);
      Complex *to = work + b->place[b->L.row[p]];
      to->re -= part.re, to->im -= part.im;
    }
  for (int64_t step = b->n - 1; step >= 0; step--) {
    work[step] = times(work[step], b->pivot[step]);
    for (int64_t p = b->U.start[step]; p < b->U.start[step + 1]; p++) {
      const Complex part = times(b->U.value[p], work[step]);
      Complex *to = work + b->U.row[p];
      to->re -= part.re, to->im -= part.im;
    }
  }
  for (int64_t step = 0; step < b->n; step++) x[b->order[step]] = work[step];
}

/* Solve A^H y = rhs. */
static void solve_adjoint(const Block *b, const Complex *rhs, Complex *y) {
  Complex *work = b->work;
  for (int64_t step = 0; step < b->n; step++) {
    Complex sum = rhs[b->order[step]];
    for (int64_t p = b->U.start[step]; p < b->U.start[step + 1]; p++) {
      const Complex part = times(conjugate(b->U.value[p]), work[b->U.row[p]]);
      sum.re -= part.re, sum.im -= part.im;
    }
    work[step] = times(sum, conjugate(b->pivot[step]));
  }
  for (int64_t step = b->n - 1; step >= 0; step--)
    for (int64_t p = b->L.start[step]; p < b->L.start[step + 1]; p++) {
      const Complex part = times(conjugate(b->L.value[p]), work[b->place[b->L.row[p]]]);
      work[step].re -= part.re, work[step].im -= part.im;
    }
  for (int64_t i = 0; i < b->n; i++) y[i] = work[b->place[i]];
}

/* Return the power of two that brings a positive number next to 1. */
INLINE double power_of_two(double x) {
  int64_t bits;
  memcpy(&bits, &x, sizeof bits);
  const int64_t exponent = bits >> 52 & 0x7ff; /* of 0 and subnormal numbers 0 */
  bits = (exponent < 23 ? 2023 : exponent > 2023 ? 23 : 2046 - exponent) << 52;
  double power;
  memcpy(&power, &bits, sizeof power);
  return power;
}

/* Scale rows and columns by powers of two until the largest entries are near 1. */
static void equilibrate(Block *b, double reach) {
  for (int64_t i = 0; i < b->n; i++) b->rows[i] = b->columns[i] = 1.0;
  for (int sweep = 0; sweep < 2; sweep++) {
    for (int64_t i = 0; i < b->n; i++) b->peaks[i] = 0.0;
    for (int64_t j = 0; j < b->n; j++)
      for (int64_t p = b->start[j]; p < b->start[j + 1]; p++) {
        const double size = (fabs(b->constant[p]) + reach * fabs(b->slope[p])) * b->columns[j];
        b->peaks[b->row[p]] = fmax(b->peaks[b->row[p]], size * b->rows[b->row[p]]);
      }
    for (int64_t i = 0; i < b->n; i++) b->rows[i] *= power_of_two(b->peaks[i]);
    for (int64_t j = 0; j < b->n; j++) {
      double peak = 0.0;
      for (int64_t p = b->start[j]; p < b->start[j + 1]; p++) {
        const double size = (fabs(b->constant[p]) + reach * fabs(b->slope[p])) * b->columns[j];
        peak = fmax(peak, size * b->rows[b->row[p]]);
      }
      b->columns[j] *= power_of_two(peak);
    }
  }
}

typedef struct {
  Complex correction;
  double sensitivity, residual;
} Judgement;

/* Set the null vectors at s. Returns 0, 1 where no factorisation beside it exists either, 2 without memory. */
static int set_null_vectors(Block *b, Complex s) {
  const double reach = fmax(hypot(s.re, s.im), UNIT * b->unit);
  equilibrate(b, reach);
  int failed = factorise(b, s);
  for (int k = 0; failed == 1 && k < 2 * BESIDE; k++) {
    const double shift = SHIFTS[k % BESIDE] * (k < BESIDE ? reach : b->unit);
    failed = factorise(b, (Complex){s.re + shift, s.im});
  }
  if (failed) return failed;
  for (int64_t i = 0; i < b->n; i++) b->x[i] = (Complex){b->seed[i], 0.0};
  for (int k = 0; k < ITERATIONS; k++) { /* each from the other, as singular vectors */
    normalise(b->n, b->x);
    solve_adjoint(b, b->x, b->y);
    normalise(b->n, b->y);
    solve(b, b->y, b->x);
  }
  for (int64_t i = 0; i < b->n; i++) {
    b->x[i].re *= b->columns[i], b->x[i].im *= b->columns[i];
    b->y[i].re *= b->rows[i], b->y[i].im *= b->rows[i];
  }
  normalise(b->n, b->x);
  normalise(b->n, b->y);
  return 0;
}

/* Judge a root by the null vectors at it, or close to it. */
static Judgement judged(const Block *b, Complex s) {
  const double modulus = hypot(s.re, s.im);
  Complex slope = {0, 0}, value = {0, 0};
  double size = 0;
  for (int64_t j = 0; j < b->n; j++) {
    const double width = hypot(b->x[j].re, b->x[j].im);
    for (int64_t p = b->start[j]; p < b->start[j + 1]; p++) {
      const Complex y = b->y[b->row[p]], both = times(conjugate(y), b->x[j]);
      const Complex part = times(both, (Complex){b->constant[p] + s.re * b->slope[p], s.im * b->slope[p]});
      slope.re += both.re * b->slope[p], slope.im += both.im * b->slope[p];
      value.re += part.re, value.im += part.im;
      size += sqrt(y.re * y.re + y.im * y.im) * width * (fabs(b->constant[p]) + modulus * fabs(b->slope[p]));
    }
  }
  const Complex step = quotient(value, slope);
  const double sensitivity = size / hypot(slope.re, slope.im);
  return (Judgement){{-step.re, -step.im}, sensitivity, hypot(step.re, step.im) / sensitivity};
}

/* Refine one root, as `_Pencil._refined`. */
static int refine(Block *b, Complex start, double room, Complex *root, double *radius, double *residual) {
  Complex value = start, next = start;
  double coarse = 0.0, error = 0.0;
  for (int k = 0; k < FACTORISATIONS; k++) {
    value = next;
    const int failed = set_null_vectors(b, value);
    if (failed) return failed;
    Judgement now = judged(b, value);
    double size = hypot(now.correction.re, now.correction.im), modulus = hypot(value.re, value.im);
    error = size + ALLOWANCE * UNIT * now.sensitivity;
    if (coarse == 0.0) coarse = 4 * error;
    next = (Complex){value.re + now.correction.re, value.im + now.correction.im};
    *residual = now.residual;
    if (!(hypot(next.re - start.re, next.im - start.im) <= room / 4)) { /* nan, too */
      *root = start;
      *radius = isfinite(coarse) ? coarse : INFINITY;
      return 0;
    }
    if (size <= 0.5 * UNIT * now.sensitivity + UNIT * modulus) break;
    const double following = NEXT * size * (size / room) * fmax(1.0, now.sensitivity / modulus);
    if (modulus > 0.0 && following <= UNIT * modulus) { /* another factorisation would find nothing but rounding */
      value = next;
      now = judged(b, value);
      size = hypot(now.correction.re, now.correction.im) + following;
      error = size + ALLOWANCE * UNIT * now.sensitivity;
      next = (Complex){value.re + now.correction.re, value.im + now.correction.im};
      *residual = now.residual;
      break;
    }
  }
  *root = next;
  *radius = 2 * error + UNIT * hypot(value.re, value.im);
  return 0;
}

/* Refine roots of det(A + s E): n unknowns, entries by columns (start, row, constant, slope), the columns in the
 * order of elimination, the largest root (unit), a first vector; `count` starts with the distances to their
 * nearest neighbours. Fills roots, radii and residuals. Returns 0, or the number of the root that could not be
 * factorised beside, from 1 on. */
ENTRY int64_t dynid_refine_roots(int64_t n, const int64_t *start, const int64_t *row, const double *constant,
                                 const double *slope, const int64_t *order, double unit, const double *seed,
                                 int64_t count, const Complex *starts, const double *rooms, Complex *roots,
                                 double *radii, double *residuals) {
  Block b = {.n = n, .start = start, .row = row, .order = order, .constant = constant, .slope = slope};
  b.seed = seed;
  b.unit = unit;
  int64_t *integers = malloc(sizeof(int64_t) * (7 * n + 2));
  Complex *numbers = malloc(sizeof(Complex) * (4 * n + 1));
  double *reals = malloc(sizeof(double) * (3 * n + 1));
  int64_t failed = 2;
  if (integers && numbers && reals) {
    b.L.start = integers, b.U.start = integers + n + 1, b.place = integers + 2 * n + 2;
    b.stack = b.place + n, b.pause = b.stack + n, b.reached = b.pause + n, b.mark = b.reached + n;
    b.work = numbers, b.x = numbers + n, b.y = numbers + 2 * n, b.pivot = numbers + 3 * n;
    b.rows = reals, b.columns = reals + n, b.peaks = reals + 2 * n;
    failed = 0;
    for (int64_t k = 0; k < count && !failed; k++) {
      failed = refine(&b, starts[k], rooms[k], roots + k, radii + k, residuals + k);
      if (failed == 1) failed = -1 - k;
    }
  }
  free(integers), free(numbers), free(reals);
  free(b.L.row), free(b.L.value), free(b.U.row), free(b.U.value);
  return failed == 2 ? NO_MEMORY : -failed;
}
