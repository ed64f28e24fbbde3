/* Real numbers of twice the usual precision with error bounds; see `dynid.lti.doubled`. */
#ifndef DYNID_REALS_H
#define DYNID_REALS_H

#include <math.h>

#include "products.h"

#define POWERS 2  /* largest power of s in a monomial, either way */

static const double SUM = 0x1p-102, PRODUCT = 0x1p-100, RECIPROCAL = 0x1p-97, UNDERFLOWN = 0x1p-1068;
static const double LEAST = 0x1p-900, MOST = 0x1p900, KNOWN = 0x1p-30, SLACK = 1.0 + 0x1p-29;

INLINE double fused(double a, double b, double c) { return __builtin_fma(a, b, c); }

/* Return a + b rounded, and its error. */
INLINE double two_sum(double a, double b, double *error) {
  const double s = a + b, t = s - a;
  *error = (a - (s - t)) + (b - t);
  return s;
}

typedef struct {
  double high, low, bound;
} Real;

INLINE Real real_sum(Real a, Real b) {
  double e;
  const double s = two_sum(a.high, b.high, &e);
  e += a.low + b.low;
  const double high = s + e;
  return (Real){high, e - (high - s), a.bound + b.bound + SUM * (fabs(a.high) + fabs(b.high))};
}

INLINE Real real_product(Real a, Real b) {
  const double p = a.high * b.high;
  const double e = fused(a.high, b.high, -p) + fused(a.high, b.low, a.low * b.high);
  const double high = p + e;
  const double error = fabs(a.high) * b.bound + a.bound * (fabs(b.high) + b.bound) +
                       (PRODUCT * fabs(high) + UNDERFLOWN);
  return (Real){high, e - (high - p), error};
}

INLINE Real real_reciprocal(Real a) {
  if (!(a.bound <= KNOWN * fabs(a.high)) || a.high == 0.0) return (Real){0.0, 0.0, INFINITY};
  const double q = 1.0 / a.high, e = (fused(-q, a.high, 1.0) - q * a.low) * q, high = q + e;
  return (Real){high, e - (high - q), SLACK * a.bound * q * q + (RECIPROCAL * fabs(q) + UNDERFLOWN)};
}

#endif
