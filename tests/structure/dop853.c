/* DOP853 of SciPy for a structure with one nonlinear joint, compiled: the same coefficients, error norm and
   dense output, without Python. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct system {
    long n, law, lines;            /* DOFs; 0 cubic, 1 jenkins, 2 bouc_wen, 3 gap; sines of the load */
    const double *A, *b, *e, *row; /* n x 2n: accelerations by the state; by the load; by the force; deflection */
    const double *p, *amplitude, *omega, *phase;
};

static double force(const struct system *s, double d, double v, double z, double *rate)
{
    const double *p = s->p;
    double f, excess;
    *rate = 0;
    switch (s->law) {
    case 0: return p[0] * d * d * d;
    case 1:
        f = p[0] * (d - z);
        *rate = fabs(f) >= p[1] && f * v > 0 ? v : 0;
        return f;
    case 2:
        *rate = v * z > 0 ? v * (1 - p[1] * fabs(z)) : v * (1 + p[2] * fabs(z));
        return p[0] * z;
    default:
        excess = fabs(d) - p[1];
        return excess > 0 ? copysign(p[0] * excess, d) + p[2] * v : 0;
    }
}

static void rates(const struct system *s, double t, const double *y, double *dy)
{
    long n = s->n;
    double u = 0, d = 0, v = 0, f;
    for (long k = 0; k < s->lines; k++)
        u += s->amplitude[k] * sin(s->omega[k] * t + s->phase[k]);
    for (long k = 0; k < n; k++) {
        d += s->row[k] * y[k];
        v += s->row[k] * y[n + k];
    }
    f = force(s, d, v, y[2 * n], &dy[2 * n]);
    for (long i = 0; i < n; i++) {
        double sum = s->b[i] * u - s->e[i] * f;
        for (long k = 0; k < 2 * n; k++)
            sum += s->A[2 * n * i + k] * y[k];
        dy[i] = y[n + i];
        dy[n + i] = sum;
    }
}

/* out (times x 2n + 1) at `times`; a (16 x 16), c (16), e3, e5 (13), dense (4 x 16); y (2n + 1): first state.
   Returns the number of steps. */
long dop853(const struct system *s, const double *a, const double *c, const double *e3, const double *e5,
            const double *dense, double rtol, const double *atol, double longest, const double *times, long count,
            double *y, double *out)
{
    long m = 2 * s->n + 1, sample = 0, steps = 0;
    double *K = calloc(16 * m, sizeof *K), *next = calloc(m, sizeof *next), *F = calloc(7 * m, sizeof *F);
    double t = times[0], h = longest / 100;
    int rejected = 0;
    for (; sample < count && times[sample] <= t; sample++)
        memcpy(out + sample * m, y, m * sizeof *y);
    rates(s, t, y, K);
    while (sample < count) {
        double err5 = 0, err3 = 0, error, factor;
        h = fmin(fmin(h, longest), times[count - 1] - t);
        for (int stage = 1; stage <= 12; stage++) { /* the last one is the end of the step */
            for (long i = 0; i < m; i++) {
                double sum = 0;
                for (int k = 0; k < stage; k++)
                    sum += a[16 * stage + k] * K[k * m + i];
                next[i] = y[i] + h * sum;
            }
            rates(s, t + c[stage] * h, next, K + stage * m);
        }
        for (long i = 0; i < m; i++) {
            double scale = atol[i] + rtol * fmax(fabs(y[i]), fabs(next[i])), five = 0, three = 0;
            for (int k = 0; k < 13; k++) {
                five += e5[k] * K[k * m + i];
                three += e3[k] * K[k * m + i];
            }
            err5 += five * five / (scale * scale);
            err3 += three * three / (scale * scale);
        }
        error = err5 + 0.01 * err3 > 0 ? h * err5 / sqrt((err5 + 0.01 * err3) * m) : 0;
        factor = error > 0 ? 0.9 * pow(error, -0.125) : 10;
        if (!(error < 1)) {
            h *= fmax(0.2, factor);
            rejected = 1;
            continue;
        }
        steps++;
        if (times[sample] <= t + h * (1 + 1e-14)) {
            double *stage_end = F; /* scratch until F is filled */
            for (int stage = 13; stage < 16; stage++) {
                for (long i = 0; i < m; i++) {
                    double sum = 0;
                    for (int k = 0; k < stage; k++)
                        sum += a[16 * stage + k] * K[k * m + i];
                    stage_end[i] = y[i] + h * sum;
                }
                rates(s, t + c[stage] * h, stage_end, K + stage * m);
            }
            for (long i = 0; i < m; i++) {
                double change = next[i] - y[i];
                F[i] = change;
                F[m + i] = h * K[i] - change;
                F[2 * m + i] = 2 * change - h * (K[12 * m + i] + K[i]);
                for (int row = 0; row < 4; row++) {
                    double sum = 0;
                    for (int k = 0; k < 16; k++)
                        sum += dense[16 * row + k] * K[k * m + i];
                    F[(3 + row) * m + i] = h * sum;
                }
            }
            for (; sample < count && times[sample] <= t + h * (1 + 1e-14); sample++) {
                double x = (times[sample] - t) / h;
                for (long i = 0; i < m; i++) {
                    double value = 0;
                    for (int k = 6, even = 1; k >= 0; k--, even = !even)
                        value = (value + F[k * m + i]) * (even ? x : 1 - x);
                    out[sample * m + i] = y[i] + value;
                }
            }
        }
        t += h;
        memcpy(y, next, m * sizeof *y);
        memcpy(K, K + 12 * m, m * sizeof *K);
        h *= fmin(rejected ? 1 : 10, factor);
        rejected = 0;
    }
    free(K);
    free(next);
    free(F);
    return steps;
}
