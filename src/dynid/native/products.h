/* Products of small matrices in vector registers.
 *
 * A compiler cannot know that small arrays of unknown sizes do not overlap; these loops keep a panel of the
 * product in registers while they go along the sum. The columns of what is written are padded to a multiple
 * of LANES numbers; every element is one sum in ascending order, whatever the padding.
 */
#ifndef DYNID_PRODUCTS_H
#define DYNID_PRODUCTS_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define LANES 8 /* what numbers of columns are padded to */
#ifdef __AVX2__
#define WIDE 4 /* numbers in a register: wider vectors than it has are split badly */
#else
#define WIDE 2
#endif
typedef double Aligned __attribute__((vector_size(8 * WIDE)));
typedef double Vector __attribute__((vector_size(8 * WIDE), aligned(8)));

#define INLINE static inline __attribute__((always_inline))

/* What an entry point returns where there is no memory. */
#define NO_MEMORY INT64_MIN

#if defined(_WIN32)
#define ENTRY __declspec(dllexport)
#else
#define ENTRY __attribute__((visibility("default")))
#endif

INLINE Aligned load(const double *at) { return *(const Vector *)at; }
INLINE void store(double *at, Aligned x) { *(Vector *)at = x; }

INLINE ptrdiff_t padded(ptrdiff_t count) { return (count + LANES - 1) / LANES * LANES; }

INLINE double total(Aligned x) {
  double sum = 0.0;
  for (int k = 0; k < WIDE; k++) sum += x[k];
  return sum;
}

/* Set (or add to) a panel of down x across registers. */
#define PANEL(DOWN, ACROSS)                                                                                  \
  do {                                                                                                       \
    Aligned sums[DOWN][ACROSS];                                                                              \
    _Pragma("GCC unroll 16") for (int r = 0; r < DOWN; r++)                                                   \
      _Pragma("GCC unroll 16") for (int c = 0; c < ACROSS; c++)                                               \
        sums[r][c] = add ? load(out + (i + r) * ldo + j + c * WIDE) : (Aligned){0};                         \
    for (ptrdiff_t k = 0; k < count; k++)                                                                    \
      _Pragma("GCC unroll 16") for (int c = 0; c < ACROSS; c++) {                                             \
        Aligned x = load(X + k * ldx + j + c * WIDE);                                                       \
        _Pragma("GCC unroll 16") for (int r = 0; r < DOWN; r++) sums[r][c] += A[(i + r) * lda + k] * x;       \
      }                                                                                                      \
    _Pragma("GCC unroll 16") for (int r = 0; r < DOWN; r++)                                                   \
      _Pragma("GCC unroll 16") for (int c = 0; c < ACROSS; c++)                                               \
        store(out + (i + r) * ldo + j + c * WIDE, sums[r][c]);                                              \
  } while (0)

/* Set `out` (rows x width) to A (rows x count) X, or add that to it. */
INLINE void multiplied(int add, ptrdiff_t rows, ptrdiff_t count, ptrdiff_t width, const double *A,
                       ptrdiff_t lda, const double *X, ptrdiff_t ldx, double *out, ptrdiff_t ldo) {
  for (ptrdiff_t j = 0; j < width; j += LANES) {
    ptrdiff_t i = 0;
    for (; i + 5 <= rows; i += 5) PANEL(5, LANES / WIDE);
    for (; i < rows; i++) PANEL(1, LANES / WIDE);
  }
}

INLINE void product(ptrdiff_t rows, ptrdiff_t count, ptrdiff_t width, const double *A, ptrdiff_t lda,
                    const double *X, ptrdiff_t ldx, double *out, ptrdiff_t ldo) {
  multiplied(0, rows, count, width, A, lda, X, ldx, out, ldo);
}

INLINE void accumulate(ptrdiff_t rows, ptrdiff_t count, ptrdiff_t width, const double *A, ptrdiff_t lda,
                       const double *X, ptrdiff_t ldx, double *out, ptrdiff_t ldo) {
  multiplied(1, rows, count, width, A, lda, X, ldx, out, ldo);
}

/* Set a row (width) to a row A (count) times X. */
INLINE void row_product(ptrdiff_t count, ptrdiff_t width, const double *A, const double *X, ptrdiff_t ldx,
                        double *out) {
  const int add = 0;
  const ptrdiff_t i = 0, lda = 0, ldo = 0;
  ptrdiff_t j = 0;
  for (; j + 4 * LANES <= width; j += 4 * LANES) PANEL(1, 4 * LANES / WIDE);
  if (j + 3 * LANES <= width) {
    PANEL(1, 3 * LANES / WIDE);
    j += 3 * LANES;
  }
  if (j + 2 * LANES <= width) {
    PANEL(1, 2 * LANES / WIDE);
    j += 2 * LANES;
  }
  for (; j < width; j += LANES) PANEL(1, LANES / WIDE);
}

/* Return the product of two rows (width). */
INLINE double dot(ptrdiff_t width, const double *a, const double *b) {
  Aligned sum = {0};
  for (ptrdiff_t c = 0; c < width; c += WIDE) sum += load(a + c) * load(b + c);
  return total(sum);
}

#endif
