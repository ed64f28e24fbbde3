/* Forces of the laws of joints, with their slopes. */
#ifndef DYNID_LAWS_H
#define DYNID_LAWS_H

#include <math.h>
#include <stdint.h>

#include "products.h"

#define VALUES 4    /* parameters of a law */
#define SLOPES 6    /* of a law by these and, the last, by its offset; even, so that registers clear them */
#define OPTIONS 6   /* numbers of a law that are no parameters: of a power the exponents, signs and kinks of d and v */
#define IWAN 6 /* the law that remembers open loops; bits of its regimes: */
#define BACKWARDS 1
#define SLIPPED 2
#define REVERSED 4

typedef struct {
  double f, d, v, z, rate, rd, rv, rz, p[SLOPES], rp[SLOPES];
} Force;

INLINE double power(double x, double exponent) {
  if (exponent == 0.0) return 1.0;
  if (exponent == 1.0) return x;
  if (exponent == 2.0) return x * x;
  if (exponent == 3.0) return x * x * x;
  return pow(x, exponent);
}

INLINE int kinked(const double *o, int which) { return o[4 + which] != 0.0; }
INLINE int whole(double exponent) { return exponent == (double)(int64_t)exponent; }

/* Clear a few numbers: a call, or a loop that a compiler makes one, takes longer than the law. */
INLINE void cleared(double *at, int count) {
  for (int k = 0; k < count; k += 4) {
    store(at + k, (Aligned){0});
    if (WIDE == 2) store(at + k + 2, (Aligned){0});
  }
}

INLINE double sign_of(int64_t regime) { return regime & BACKWARDS ? -1.0 : 1.0; }

/* The deflection from which on all sliders of Iwan slip, and its slopes by the parameters; see `hysteretic_laws`. */
INLINE double all_slip(const double *p, double *by) {
  const double a = p[2] + 1.0, c = p[3] + a / (a + 1.0), phi = p[1] * (1.0 + p[3]) / (p[0] * c);
  by[0] = -phi / p[0], by[1] = phi / p[1], by[2] = -phi / ((a + 1.0) * (a + 1.0) * c);
  by[3] = phi * (1.0 / (1.0 + p[3]) - 1.0 / c);
  return phi;
}

/* The force of first loading, its slope, and its slopes by the parameters. */
INLINE double backbone(const double *p, double u, double *slope, double *by) {
  double of_phi[VALUES];
  const double phi = all_slip(p, of_phi), a = p[2] + 1.0, ratio = u > 0.0 ? u / phi : 0.0;
  const double log_ratio = ratio > 0.0 ? log(ratio) : 0.0;
  const double w = (ratio > 0.0 ? exp(a * log_ratio) : 0.0) / ((1.0 + p[3]) * (a + 1.0));
  for (int k = 0; k < VALUES; k++) {
    double of_w = -w * a * of_phi[k] / phi;
    if (k == 2) of_w += w * (log_ratio - 1.0 / (a + 1.0));
    if (k == 3) of_w -= w / (1.0 + p[3]);
    by[k] = -p[0] * u * of_w;
  }
  by[0] += u * (1.0 - w);
  *slope = p[0] * (1.0 - w * (1.0 + a));
  return p[0] * u * (1.0 - w);
}

/* A factor of a power law and its slope, continued smoothly beyond the regime. */
INLINE void factor(const double *o, int which, int64_t regime, double x, double *value, double *slope) {
  const double exponent = o[which];
  *value = 1.0;
  *slope = 0.0;
  if (exponent == 0.0) return;
  if (!kinked(o, which)) {
    *value = power(x, exponent);
    *slope = exponent * power(x, exponent - 1.0);
    return;
  }
  const double sign = regime >> which & 1 ? -1.0 : 1.0, odd = o[2 + which] != 0.0 ? sign : 1.0;
  double base = sign * x;
  if (base < 0.0 && !whole(exponent)) base = 0.0;
  *value = odd * power(base, exponent);
  *slope = odd * sign * exponent * power(base, exponent - 1.0);
}

/* The force of a law with parameters p in a regime r, less that of its preload alone; see `dynid.structure.law`. */
INLINE void law_force(int64_t code, const double *p, const double *s, const double *opt, double offset, double began, int64_t r, double d, double v, double z, Force *o) {
  cleared((double *)o, sizeof *o / sizeof(double));
  const int shifted = code == 1 || code == 4;
  if (shifted) d += offset;
  if (code == 1) {
    double a, da, b, db;
    factor(opt, 0, r, d, &a, &da);
    factor(opt, 1, r, v, &b, &db);
    o->f = p[0] * a * b, o->d = p[0] * da * b, o->v = p[0] * a * db, o->p[0] = a * b;
  } else if (code == 2) {
    if (r) {
      o->f = r * p[1], o->p[1] = r;
    } else {
      o->f = p[0] * (d - z), o->d = p[0], o->z = -p[0], o->p[0] = d - z;
    }
  } else if (code == 3) {
    const double e = d - z, sign = r & 2 ? -1.0 : 1.0, exponent = opt[0];
    o->f = p[0] * e, o->d = p[0], o->z = -p[0], o->p[0] = e;
    double base = sign * e;
    if (base < 0.0 && !whole(exponent)) base = 0.0;
    const int loading = r == 0 || r == 3;
    const double change = loading ? p[1] : -p[2], raised = power(base, exponent);
    o->rate = v * change * raised, o->rv = change * raised;
    o->rd = v * change * sign * exponent * power(base, exponent - 1.0), o->rz = -o->rd;
    o->rp[loading ? 1 : 2] = loading ? v * raised : -v * raised;
  } else if (code == 4 && r) {
    const double e = d - r * p[1];
    o->f = p[0] * e + p[2] * v, o->d = p[0], o->v = p[2];
    o->p[0] = e, o->p[1] = -r * p[0], o->p[2] = v;
  } else if (code == 5) {
    const double ratio = v / p[1], tangent = tanh(ratio);
    o->f = p[0] * tangent, o->v = p[0] / p[1] * (1.0 - tangent * tangent);
    o->p[0] = tangent, o->p[1] = -o->v * ratio;
  } else if (code == IWAN) {
    const double sign = sign_of(r), scale = r & REVERSED ? 2.0 : 1.0;
    o->f = began;
    if ((r & (SLIPPED | REVERSED)) == SLIPPED) {
      o->f += sign * p[1], o->p[1] = sign;
    } else {
      double slope, by[VALUES];
      o->f += scale * sign * backbone(p, sign * (d - z) / scale, &slope, by);
      o->d = slope, o->z = -slope;
      for (int k = 0; k < VALUES; k++) o->p[k] = scale * sign * by[k];
    }
  }
  if (shifted) {
    o->f -= s[0];
    for (int k = 0; k < VALUES; k++) o->p[k] -= s[2 + k];
    o->p[SLOPES - 1] = o->d - s[1];
  }
}

/* The regime in which a motion is, of laws that have one for each deflection, rate and hidden state. */
INLINE int64_t law_regime(int64_t code, const double *p, const double *opt, double offset, double d, double v, double z) {
  if (code == 1) return (kinked(opt, 0) && d + offset < 0.0) | (kinked(opt, 1) && v < 0.0) << 1;
  if (code == 3) return (v < 0.0) | (d < z) << 1;
  if (code == 4) return opt[0] != 0.0 && d + offset > p[1] ? 1 : opt[1] != 0.0 && -(d + offset) > p[1] ? -1 : 0;
  return 0;
}

#endif
