/* Householder reflections and one-sided Jacobi rotations of small matrices in vector registers. */
#ifndef DYNID_ORTHOGONAL_H
#define DYNID_ORTHOGONAL_H

#include <math.h>
#include <stdlib.h>

#include "products.h"

#define ROWS 64 /* rows that are reflected at once */

/* Set the products of columns from `first` on with a column of a block (w x ROWS), four at a time. */
INLINE void products_with(const double *pivot, const double *block, int64_t first, int64_t w, double *products) {
  int64_t k = first;
  for (; k + 4 <= w; k += 4) {
    Aligned sums[4] = {{0}};
    for (int64_t c = 0; c < ROWS; c += WIDE) {
      const Aligned x = load(pivot + c);
      for (int64_t r = 0; r < 4; r++) sums[r] += load(block + (k + r) * ROWS + c) * x;
    }
    for (int64_t r = 0; r < 4; r++) products[k + r] = total(sums[r]);
  }
  for (; k < w; k++) products[k] = dot(ROWS, block + k * ROWS, pivot);
}

/* Reflect the rows of a block (w x ROWS) into a triangle (w x w; Householder). */
INLINE void reflect(double *R, double *block, double *products, int64_t w) {
  for (int64_t j = 0; j < w; j++) {
    const double *pivot = block + j * ROWS;
    products_with(pivot, block, j, w, products);
    const double square = products[j];
    if (square < 1e-280) continue; /* of columns near one: rounding of rounding, whose reciprocal overflows */
    const double diagonal = R[j * w + j], length = copysign(sqrt(diagonal * diagonal + square), diagonal);
    const double head = diagonal + length, share = 1.0 / (length * head);
    R[j * w + j] = -length;
    for (int64_t k = j + 1; k < w; k++) {
      const double scaled = -(head * R[j * w + k] + products[k]) * share;
      R[j * w + k] += scaled * head;
      for (int64_t c = 0; c < ROWS; c += WIDE)
        store(block + k * ROWS + c, load(block + k * ROWS + c) + scaled * load(pivot + c));
    }
  }
}

/* Turn rows (count x width, a multiple of LANES) until they are orthogonal, and numbers beside them (absent: none).
 * One-sided Jacobi: small singular values, the lengths of the rows, keep their digits. M. R. Hestenes, J. Soc. Indust.
 * Appl. Math. 6 (1958) 51-90. */
INLINE void orthogonalise(int64_t count, int64_t width, double *rows, double *beside) {
  int turned = 1;
  for (int sweep = 0; turned && sweep < 60; sweep++) {
    turned = 0;
    for (int64_t i = 0; i < count; i++)
      for (int64_t j = i + 1; j < count; j++) {
        double *one = rows + i * width, *other = rows + j * width;
        Aligned sums[3] = {{0}};
        for (int64_t c = 0; c < width; c += WIDE) {
          const Aligned x = load(one + c), y = load(other + c);
          sums[0] += x * x;
          sums[1] += y * y;
          sums[2] += x * y;
        }
        const double a = total(sums[0]), d = total(sums[1]), both = total(sums[2]);
        if (!(fabs(both) > 1e-15 * sqrt(a) * sqrt(d))) continue;
        const double zeta = (d - a) / (2 * both), t = copysign(1.0, zeta) / (fabs(zeta) + hypot(1.0, zeta));
        const double cosine = 1 / sqrt(1 + t * t), sine = cosine * t;
        for (int64_t c = 0; c < width; c += WIDE) {
          const Aligned x = load(one + c), y = load(other + c);
          store(one + c, cosine * x - sine * y);
          store(other + c, sine * x + cosine * y);
        }
        if (beside) {
          const double x = beside[i], y = beside[j];
          beside[i] = cosine * x - sine * y;
          beside[j] = sine * x + cosine * y;
        }
        turned = 1;
      }
  }
}

/* Return the largest square of the lengths of rows, which are set (count). */
INLINE double squares_of(int64_t count, int64_t width, const double *rows, double *squares) {
  double largest = 0.0;
  for (int64_t i = 0; i < count; i++) {
    squares[i] = dot(width, rows + i * width, rows + i * width);
    largest = squares[i] > largest ? squares[i] : largest;
  }
  return largest;
}

/* Return the power of two that brings the largest number of a matrix (rows x columns of a row) near to one. */
INLINE double near_one(int64_t rows, int64_t columns, int64_t pitch, const double *A) {
  double largest = 0.0;
  int exponent = 0;
  for (int64_t k = 0; k < rows; k++)
    for (int64_t c = 0; c < columns; c++) largest = fabs(A[k * pitch + c]) > largest ? fabs(A[k * pitch + c]) : largest;
  frexp(largest, &exponent);
  return ldexp(1.0, exponent > 1000 ? -1000 : exponent < -1000 ? 1000 : -exponent);
}

/* Set the shortest x (n) for which A x is nearest to b, singular values below `rank` of the largest left out; of rows
 * [A, b] (rows x n + 1). Returns 0 where there is no memory. */
INLINE int least_squares(int64_t rows, int64_t n, const double *A, double rank, double *x) {
  const int64_t w = n + 1, width = padded(n);
  double *all = calloc(w * ROWS + 3 * padded(w) + padded(w * w) + n * width, sizeof(double)), *block = all;
  if (!all) return 0;
  double *products = block + w * ROWS, *b = products + padded(w), *squares = b + padded(w);
  double *triangle = squares + padded(w), *R = triangle + padded(w * w);
  const double power = near_one(rows, n, w, A);
  for (int64_t first = 0; first < rows; first += ROWS) {
    memset(block, 0, w * ROWS * sizeof(double));
    for (int64_t k = 0; k < ROWS && first + k < rows; k++)
      for (int64_t c = 0; c < w; c++) block[c * ROWS + k] = power * A[(first + k) * w + c];
    reflect(triangle, block, products, w);
  }
  for (int64_t i = 0; i < n; i++) {
    memcpy(R + i * width + i, triangle + i * w + i, (n - i) * sizeof(double));
    b[i] = triangle[i * w + n];
    x[i] = 0.0;
  }
  orthogonalise(n, width, R, b);
  const double least = rank * rank * squares_of(n, width, R, squares);
  for (int64_t i = 0; i < n; i++)
    if (squares[i] > least)
      for (int64_t k = 0; k < n; k++) x[k] += b[i] / squares[i] * R[i * width + k];
  free(all);
  return 1;
}

#endif
