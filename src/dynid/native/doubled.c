/* Complex numbers of twice the usual precision, with error bounds; see `dynid.bondgraph.program.frequency_sweep`,
 * whose comments hold here; and products with real matrices, as in `dynid.structure.modes.pencil`. Every rounding
 * counts: compiled without contraction, fused where it is written. */
#include "reals.h"

#define BLOCK 64 /* frequencies in a block */
#define PARTS 6  /* rows of a register */
enum { LOAD, SHIFT, ADD, SUB, MUL, INV, NEG };

/* Return |re + j im|, by the sum of the parts where their squares would leave the range. */
INLINE double modulus_of(double re, double im) {
  const double square = re * re + im * im, root = sqrt(square);
  return (square > LEAST) & (square < MOST) ? root : fabs(re) + fabs(im);
}

typedef double Powers[2 * POWERS + 1][3][BLOCK];

/* Set the powers of a block of frequencies: high part, low part and error bound. */
INLINE void set_powers(const double *omega, Powers table) {
  for (int i = 0; i < BLOCK; i++) {
    const Real up = {omega[i], 0.0, 0.0}, down = real_reciprocal(up);
    Real rising = up, falling = down;
    table[POWERS][0][i] = 1.0;
    table[POWERS][1][i] = table[POWERS][2][i] = 0.0;
    for (int power = 1; power <= POWERS; power++) {
      table[POWERS + power][0][i] = rising.high;
      table[POWERS + power][1][i] = rising.low;
      table[POWERS + power][2][i] = rising.bound;
      table[POWERS - power][0][i] = falling.high;
      table[POWERS - power][1][i] = falling.low;
      table[POWERS - power][2][i] = falling.bound;
      rising = real_product(rising, up);
      falling = real_product(falling, down);
    }
  }
}

/* High and low parts of the real and the imaginary part of number j^power. */
typedef struct {
  double rh, rl, ih, il;
} Turned;

INLINE Turned turned(const double *number, int64_t power) {
  const double turn = power & 2 ? -1.0 : 1.0; /* of negative powers too: two's complement */
  const double high = turn * number[0], low = turn * number[1];
  return power & 1 ? (Turned){0.0, 0.0, high, low} : (Turned){high, low, 0.0, 0.0};
}

INLINE void set_monomial(const double *number, int64_t power, Powers powers, double *restrict c) {
  const Turned n = turned(number, power);
  const double size = fabs(number[0]), error = number[2];
  const double(*w)[BLOCK] = (const double(*)[BLOCK])powers[POWERS + power];
  for (int i = 0; i < BLOCK; i++) {
    const double re = n.rh * w[0][i], e = fused(n.rh, w[1][i], n.rl * w[0][i]);
    const double im = n.ih * w[0][i], f = fused(n.ih, w[1][i], n.il * w[0][i]);
    const double modulus = fabs(re) + fabs(im); /* one of them is zero */
    c[i] = re;
    c[BLOCK + i] = fused(n.rh, w[0][i], -re) + e;
    c[2 * BLOCK + i] = im;
    c[3 * BLOCK + i] = fused(n.ih, w[0][i], -im) + f;
    c[4 * BLOCK + i] = modulus;
    c[5 * BLOCK + i] = size * w[2][i] + error * (w[0][i] + w[2][i]) + (PRODUCT * modulus + UNDERFLOWN);
  }
}

INLINE void set_shifted(const double *restrict a, const double *number, int64_t power, Powers powers,
                        double *restrict c) {
  const Turned n = turned(number, power);
  const double size = fabs(number[0]), error = number[2];
  const double(*w)[BLOCK] = (const double(*)[BLOCK])powers[POWERS + power];
  for (int i = 0; i < BLOCK; i++) {
    const double p = n.rh * w[0][i], q = n.ih * w[0][i];
    double e, f;
    const double s = two_sum(a[i], p, &e), t = two_sum(a[2 * BLOCK + i], q, &f);
    e += a[BLOCK + i] + (fused(n.rh, w[0][i], -p) + fused(n.rh, w[1][i], n.rl * w[0][i]));
    f += a[3 * BLOCK + i] + (fused(n.ih, w[0][i], -q) + fused(n.ih, w[1][i], n.il * w[0][i]));
    const double re = s + e, im = t + f, modulus = fabs(p) + fabs(q); /* one of them is zero */
    const double added = size * w[2][i] + error * (w[0][i] + w[2][i]) + (PRODUCT * modulus + UNDERFLOWN);
    c[i] = re;
    c[BLOCK + i] = e - (re - s);
    c[2 * BLOCK + i] = im;
    c[3 * BLOCK + i] = f - (im - t);
    c[4 * BLOCK + i] = modulus_of(re, im);
    c[5 * BLOCK + i] = a[5 * BLOCK + i] + added + SUM * (a[4 * BLOCK + i] + modulus);
  }
}

INLINE void set_sum(const double *restrict a, const double *restrict b, double *restrict c, double sign) {
  for (int i = 0; i < BLOCK; i++) {
    double e, f;
    const double s = two_sum(a[i], sign * b[i], &e), t = two_sum(a[2 * BLOCK + i], sign * b[2 * BLOCK + i], &f);
    e += a[BLOCK + i] + sign * b[BLOCK + i];
    f += a[3 * BLOCK + i] + sign * b[3 * BLOCK + i];
    const double re = s + e, im = t + f;
    c[i] = re;
    c[BLOCK + i] = e - (re - s);
    c[2 * BLOCK + i] = im;
    c[3 * BLOCK + i] = f - (im - t);
    c[4 * BLOCK + i] = modulus_of(re, im);
    c[5 * BLOCK + i] = a[5 * BLOCK + i] + b[5 * BLOCK + i] + SUM * (a[4 * BLOCK + i] + b[4 * BLOCK + i]);
  }
}

/* Return the high part of a b - c d of double-doubles, and set the low one. */
INLINE double difference_of_products(double ah, double al, double bh, double bl, double ch, double cl,
                                     double dh, double dl, double *low) {
  const double p = ah * bh, q = ch * dh;
  double error;
  const double s = two_sum(p, -q, &error);
  error += fused(ah, bh, -p) - fused(ch, dh, -q);
  error += fused(ah, bl, al * bh) - fused(ch, dl, cl * dh);
  const double high = s + error;
  *low = error - (high - s);
  return high;
}

INLINE void set_product(const double *restrict a, const double *restrict b, double *restrict c) {
  for (int i = 0; i < BLOCK; i++) {
    const double arh = a[i], arl = a[BLOCK + i], aih = a[2 * BLOCK + i], ail = a[3 * BLOCK + i];
    const double brh = b[i], brl = b[BLOCK + i], bih = b[2 * BLOCK + i], bil = b[3 * BLOCK + i];
    const double size_a = a[4 * BLOCK + i], error_a = a[5 * BLOCK + i];
    const double size_b = b[4 * BLOCK + i], error_b = b[5 * BLOCK + i];
    double rl, il;
    c[i] = difference_of_products(arh, arl, brh, brl, aih, ail, bih, bil, &rl);
    c[2 * BLOCK + i] = difference_of_products(arh, arl, bih, bil, -aih, -ail, brh, brl, &il);
    c[BLOCK + i] = rl;
    c[3 * BLOCK + i] = il;
    const double size = size_a * size_b;
    c[4 * BLOCK + i] = size;
    c[5 * BLOCK + i] = size_a * error_b + error_a * (size_b + error_b) + (PRODUCT * size + UNDERFLOWN);
  }
}

INLINE void set_reciprocal(const double *restrict a, double *restrict c) {
  for (int i = 0; i < BLOCK; i++) {
    const double rh = a[i], rl = a[BLOCK + i], ih = a[2 * BLOCK + i], il = a[3 * BLOCK + i];
    const double size = a[4 * BLOCK + i], error = a[5 * BLOCK + i];
    const double square = rh * rh + ih * ih, inverse = 1.0 / square;
    const double ur = rh * inverse, ui = -ih * inverse;
    /* what the rounded reciprocal leaves over: 1 - a u, a sum of exact products */
    double p = rh * ur, q = ih * ui, e, f, t;
    const double s = two_sum(1.0, -p, &e);
    t = two_sum(s, q, &f);
    const double left_r = t + (e + f + (fused(ih, ui, -q) - fused(rh, ur, -p)) - (rl * ur - il * ui));
    p = rh * ui;
    q = ih * ur;
    t = two_sum(-p, -q, &f);
    const double left_i = t + (f - (fused(rh, ui, -p) + fused(ih, ur, -q)) - (rl * ui + il * ur));
    const double dr = left_r * ur - left_i * ui, di = left_r * ui + left_i * ur;
    const double re = ur + dr, im = ui + di, modulus = size * inverse;
    const int sound = (error <= KNOWN * size) & (square > LEAST) & (square < MOST);
    const double bound = SLACK * error * inverse + (RECIPROCAL * modulus + UNDERFLOWN);
    c[i] = re;
    c[BLOCK + i] = dr - (re - ur);
    c[2 * BLOCK + i] = im;
    c[3 * BLOCK + i] = di - (im - ui);
    c[4 * BLOCK + i] = modulus;
    c[5 * BLOCK + i] = sound ? bound : INFINITY;
  }
}

/* Run a tape at one block of frequencies: rows (steps x 5) of operation, operands, target and power; numbers
 * (steps x 3) of the monomials; memory (slots x PARTS * BLOCK). */
ENTRY int64_t dynid_run_tape(int64_t steps, const int64_t *rows, const double *numbers, const double *omega,
                             double *memory) {
  Powers powers;
  set_powers(omega, powers);
  for (int64_t step = 0; step < steps; step++) {
    const int64_t *row = rows + 5 * step;
    const double *number = numbers + 3 * step;
    const double *a = memory + row[1] * PARTS * BLOCK, *b = memory + row[2] * PARTS * BLOCK;
    double *c = memory + row[3] * PARTS * BLOCK;
    switch (row[0]) {
    case INV: set_reciprocal(a, c); break;
    case MUL: set_product(a, b, c); break;
    case SHIFT: set_shifted(a, number, row[4], powers, c); break;
    case ADD: set_sum(a, b, c, 1.0); break;
    case SUB: set_sum(a, b, c, -1.0); break;
    case LOAD: set_monomial(number, row[4], powers, c); break;
    default:
      for (int i = 0; i < 4 * BLOCK; i++) c[i] = -a[i];
      for (int i = 4 * BLOCK; i < PARTS * BLOCK; i++) c[i] = a[i];
    }
  }
  return 0;
}

/* Set K x and its rounding error for vectors x (count x n); K by rows, each with its columns ascending. */
ENTRY int64_t dynid_doubled_product(int64_t n, const int64_t *starts, const int64_t *columns, const double *entries,
                                    int64_t count, const double *vectors, double *high, double *low) {
  for (int64_t vector = 0; vector < count; vector++) {
    const double *x = vectors + vector * n;
    for (int64_t row = 0; row < n; row++) {
      double sum = 0.0, lost = 0.0;
      for (int64_t k = starts[row]; k < starts[row + 1]; k++) {
        const double product = entries[k] * x[columns[k]];
        double error;
        sum = two_sum(sum, product, &error);
        lost += error + fused(entries[k], x[columns[k]], -product);
      }
      high[vector * n + row] = sum;
      low[vector * n + row] = lost;
    }
  }
  return 0;
}

/* Set (high + low) right (count x columns) for (high + low) (count x n) and right (n x columns); work holds
 * two rows. */
ENTRY int64_t dynid_doubled_gram(int64_t n, int64_t count, int64_t columns, const double *high, const double *low,
                                 const double *right, double *work, double *out) {
  double *restrict sum = work, *restrict lost = work + columns;
  for (int64_t vector = 0; vector < count; vector++) {
    for (int64_t k = 0; k < 2 * columns; k++) work[k] = 0.0;
    for (int64_t row = 0; row < n; row++) {
      const double a = high[vector * n + row], b = low[vector * n + row], *restrict x = right + row * columns;
      for (int64_t k = 0; k < columns; k++) {
        const double product = a * x[k];
        double error;
        sum[k] = two_sum(sum[k], product, &error);
        lost[k] += error + (fused(a, x[k], -product) + b * x[k]);
      }
    }
    for (int64_t k = 0; k < columns; k++) out[vector * columns + k] = sum[k] + lost[k];
  }
  return 0;
}
