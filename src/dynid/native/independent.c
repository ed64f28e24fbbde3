/* Linearly independent columns from their products, see `dynid.identification.likelihood.saturated_model._triangle`; ranges and
 * least squares of small matrices, see `dynid.identification.least_squares`. */
#include "orthogonal.h"

/* Take the independent ones among the first `active` columns, `most` at the most, out of their products `left`
 * (d x d, overwritten): their places, and all columns in their directions (rows, most x d). Returns how many
 * there are, or -1 where digits are lacking: `digits` times rounding, for columns of `least` and above. */
ENTRY int64_t dynid_independent(int64_t d, double *left, int64_t active, int64_t most, double digits,
                                double least, double rounded, int64_t *places, double *rows) {
  double rounding = 0x1p-52;
  int64_t found = 0;
  for (int64_t k = 0; k < active && found < most; k++) {
    const double square = left[k * d + k], floor = least * least;
    if (rounding > digits * (square > floor ? square : floor)) return -1;
    if (!(square > floor)) continue;
    double *row = rows + found * d, largest = 0.0;
    for (int64_t c = 0; c < d; c++) row[c] = left[k * d + c] / sqrt(square);
    for (int64_t i = k + 1; i < d; i++) /* what was taken is not read again */
      for (int64_t c = 0; c < d; c++) left[i * d + c] -= row[i] * row[c];
    places[found++] = k;
    for (int64_t c = k + 1; c < d; c++) largest = fabs(row[c]) > largest ? fabs(row[c]) : largest;
    if (square < rounded && largest * largest > square) rounding *= largest * largest / square;
  }
  return found;
}

/* Set the first rows of `basis` (columns x rows) to an orthonormal basis of the range of A (rows x columns), singular
 * values below `rank` of the largest left out. Returns how many there are. */
ENTRY int64_t dynid_range(int64_t rows, int64_t columns, const double *A, double rank, double *basis) {
  const int64_t width = padded(rows);
  double *turned = calloc(columns * width + columns + 1, sizeof(double)), *squares = turned + columns * width;
  if (!turned) return NO_MEMORY;
  const double power = near_one(rows, columns, columns, A);
  for (int64_t k = 0; k < rows; k++)
    for (int64_t c = 0; c < columns; c++) turned[c * width + k] = power * A[k * columns + c];
  orthogonalise(columns, width, turned, NULL);
  const double least = rank * rank * squares_of(columns, width, turned, squares);
  int64_t found = 0;
  for (int64_t c = 0; c < columns; c++) {
    if (!(squares[c] > least)) continue;
    for (int64_t k = 0; k < rows; k++) basis[found * rows + k] = turned[c * width + k] / sqrt(squares[c]);
    found++;
  }
  free(turned);
  return found;
}

/* Set the shortest least-squares solution (columns) of rows [A, b] (rows x columns + 1). */
ENTRY int64_t dynid_least_squares(int64_t rows, int64_t columns, const double *both, double rank, double *x) {
  return least_squares(rows, columns, both, rank, x) ? 0 : NO_MEMORY;
}
