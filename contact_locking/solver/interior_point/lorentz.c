/* Loops run along the cones, so that they use vector instructions, and take a chunk of them at a
   time, so that what is needed on the way stays in the processor's first cache. */

#include <math.h>

#define CHUNK 128

/* The chunks of n cones that begin at ``begin``, the rows of an array there, and loops. */
#define FOR_CHUNKS                                                                                 \
  for (long begin = 0, n; n = count - begin < CHUNK ? count - begin : CHUNK, begin < count;        \
       begin += CHUNK)
#define ROW(a, i) ((a) + (i) * count + begin)
#define FOR_ROWS(first) for (int i = first; i < rows; i++)
#define FOR_CONES for (long j = 0; j < n; j++)

/* y becomes W y (sign 1) or W^-1 y (sign -1).  As W = eta (2 v v^T - J) with v = (w + e)/
   sqrt(2 (w_0 + 1)), the first component of W y/eta is w . y, and the others are those of y and
   w (y_0 + w_1 . y_1/(w_0 + 1)).  W^-1 has J w in the place of w, and 1/eta. */
static inline void scale(int rows, long n, long count, double sign, const double *eta,
                         const double *w, double y[][CHUNK])
{
  double dot[CHUNK] = {0.0}, along[CHUNK], factor[CHUNK];
  FOR_ROWS(1) FOR_CONES dot[j] += w[i * count + j] * y[i][j];
  FOR_CONES
  {
    along[j] = y[0][j] + sign * dot[j] / (w[j] + 1.0);
    factor[j] = sign > 0.0 ? eta[j] : 1.0 / eta[j];
    y[0][j] = factor[j] * (w[j] * y[0][j] + sign * dot[j]);
  }
  FOR_ROWS(1) FOR_CONES y[i][j] = factor[j] * (y[i][j] + sign * along[j] * w[i * count + j]);
}

/* What takes v into [low, high], and no more than high down. */
static inline double into_band(double v, double low, double high)
{
  double change = (v < low ? low : v > high ? high : v) - v;
  return change < -high ? -high : change;
}

void lorentz_size(int rows, long count, const double *restrict x, double *restrict size)
{
  FOR_CHUNKS
  {
    double square[CHUNK] = {0.0};
    FOR_ROWS(1) FOR_CONES square[j] += ROW(x, i)[j] * ROW(x, i)[j];
    FOR_CONES
    {
      /* As a product det x keeps its digits near the boundary of the cone. */
      double x_0 = ROW(x, 0)[j], norm = sqrt(square[j]);
      ROW(size, 0)[j] = sqrt((x_0 - norm) * (x_0 + norm));
    }
  }
}

void lorentz_scaling(int rows, long count, const double *restrict x, const double *restrict z,
                     const double *restrict size_x, const double *restrict size_z,
                     double *restrict eta, double *restrict w, double *restrict lambda)
{
  FOR_CHUNKS
  {
    double dot[CHUNK] = {0.0}, w_x[CHUNK], w_z[CHUNK], lambda_x[CHUNK], lambda_z[CHUNK];
    FOR_ROWS(0) FOR_CONES dot[j] += ROW(x, i)[j] * ROW(z, i)[j];
    FOR_CONES
    {
      double s_x = ROW(size_x, 0)[j], s_z = ROW(size_z, 0)[j], size = sqrt(s_x * s_z);
      double x_0 = ROW(x, 0)[j] / s_x, z_0 = ROW(z, 0)[j] / s_z;
      double gamma = sqrt(0.5 * (1.0 + dot[j] / (s_x * s_z))), total = x_0 + z_0 + 2.0 * gamma;
      ROW(eta, 0)[j] = sqrt(s_x / s_z);
      ROW(w, 0)[j] = (x_0 + z_0) / (2.0 * gamma);
      ROW(lambda, 0)[j] = gamma * size;
      w_x[j] = 0.5 / (gamma * s_x);
      w_z[j] = -0.5 / (gamma * s_z);
      lambda_x[j] = size * (gamma + z_0) / (total * s_x);
      lambda_z[j] = size * (gamma + x_0) / (total * s_z);
    }
    FOR_ROWS(1) FOR_CONES
    {
      double x_i = ROW(x, i)[j], z_i = ROW(z, i)[j];
      ROW(w, i)[j] = w_x[j] * x_i + w_z[j] * z_i;
      ROW(lambda, i)[j] = lambda_x[j] * x_i + lambda_z[j] * z_i;
    }
  }
}

void lorentz_aim(int rows, long count, double target, const double *restrict x,
                 const double *restrict z, const double *restrict size_x,
                 const double *restrict size_z, const double *restrict eta,
                 const double *restrict w, const double *restrict lambda,
                 const double *restrict correction, double *restrict b)
{
  FOR_CHUNKS
  {
    double y[rows][CHUNK], dot[CHUNK] = {0.0}, share[CHUNK];
    if (correction)
    {
      FOR_ROWS(1) FOR_CONES dot[j] += ROW(lambda, i)[j] * ROW(correction, i)[j];
      FOR_CONES
      {
        double det = ROW(size_x, 0)[j] * ROW(size_z, 0)[j];
        y[0][j] = (ROW(lambda, 0)[j] * ROW(correction, 0)[j] - dot[j]) / det;
        share[j] = 1.0 / ROW(lambda, 0)[j];
      }
      FOR_ROWS(1) FOR_CONES
        y[i][j] = (ROW(correction, i)[j] - y[0][j] * ROW(lambda, i)[j]) * share[j];
      scale(rows, n, count, -1.0, ROW(eta, 0), ROW(w, 0), y);
    }
    else
      FOR_ROWS(0) FOR_CONES y[i][j] = 0.0;
    FOR_CONES
    {
      share[j] = target / (ROW(size_x, 0)[j] * ROW(size_x, 0)[j]);
      ROW(b, 0)[j] = share[j] * ROW(x, 0)[j] - ROW(z, 0)[j] - y[0][j];
    }
    FOR_ROWS(1) FOR_CONES
      ROW(b, i)[j] = -share[j] * ROW(x, i)[j] - ROW(z, i)[j] - y[i][j];
  }
}

void lorentz_product(int rows, long count, double t, const double *restrict x,
                     const double *restrict z, const double *restrict dx,
                     const double *restrict dz, const double *restrict eta,
                     const double *restrict w, double *restrict product)
{
  FOR_CHUNKS
  {
    double a[rows][CHUNK], b[rows][CHUNK];
    FOR_ROWS(0) FOR_CONES
    {
      a[i][j] = ROW(x, i)[j] + t * ROW(dx, i)[j];
      b[i][j] = ROW(z, i)[j] + t * ROW(dz, i)[j];
    }
    scale(rows, n, count, -1.0, ROW(eta, 0), ROW(w, 0), a);
    scale(rows, n, count, 1.0, ROW(eta, 0), ROW(w, 0), b);
    FOR_CONES ROW(product, 0)[j] = a[0][j] * b[0][j];
    FOR_ROWS(1) FOR_CONES
    {
      ROW(product, 0)[j] += a[i][j] * b[i][j];
      ROW(product, i)[j] = a[0][j] * b[i][j] + b[0][j] * a[i][j];
    }
  }
}

void lorentz_into_band(int rows, long count, double low, double high,
                       const double *restrict product, double *restrict change)
{
  FOR_CHUNKS
  {
    double square[CHUNK] = {0.0}, along[CHUNK];
    FOR_ROWS(1) FOR_CONES square[j] += ROW(product, i)[j] * ROW(product, i)[j];
    FOR_CONES
    {
      double norm = sqrt(square[j]), v_0 = ROW(product, 0)[j];
      double least = into_band(v_0 - norm, low, high), most = into_band(v_0 + norm, low, high);
      ROW(change, 0)[j] = 0.5 * (most + least);
      along[j] = norm > 0.0 ? 0.5 * (most - least) / norm : 0.0;
    }
    FOR_ROWS(1) FOR_CONES ROW(change, i)[j] = along[j] * ROW(product, i)[j];
  }
}

double lorentz_speed(int rows, long count, double share, const double *restrict x,
                     const double *restrict size, const double *restrict dx,
                     const double *restrict other, double *restrict speeds)
{
  double most = -INFINITY;
  FOR_CHUNKS
  {
    double d[rows][CHUNK], dot[CHUNK] = {0.0}, along[CHUNK], square[CHUNK] = {0.0};
    if (share == 0.0)
      FOR_ROWS(0) FOR_CONES d[i][j] = ROW(dx, i)[j];
    else
      FOR_ROWS(0) FOR_CONES d[i][j] = ROW(dx, i)[j] + share * (ROW(other, i)[j] - ROW(dx, i)[j]);
    FOR_ROWS(1) FOR_CONES dot[j] += ROW(x, i)[j] * d[i][j];
    FOR_CONES
    {
      double s = ROW(size, 0)[j], x_0 = ROW(x, 0)[j], d_0 = d[0][j];
      dot[j] = (x_0 * d_0 - dot[j]) / s;
      along[j] = (dot[j] + d_0) / (x_0 + s);
    }
    FOR_ROWS(1) FOR_CONES
    {
      double across = along[j] * ROW(x, i)[j] - d[i][j];
      square[j] += across * across;
    }
    FOR_CONES square[j] = (sqrt(square[j]) - dot[j]) / ROW(size, 0)[j];
    FOR_CONES
      if (square[j] > most || isnan(square[j]))
        most = square[j];
    if (speeds)
      FOR_CONES ROW(speeds, 0)[j] = fmax(ROW(speeds, 0)[j], square[j]);
  }
  return most;
}

double lorentz_total(int rows, long count, double t, const double *restrict weights,
                     const double *restrict x, const double *restrict z,
                     const double *restrict dx, const double *restrict dz)
{
  double total = 0.0;
  FOR_CHUNKS
  {
    double dot[CHUNK] = {0.0};
    FOR_ROWS(0) FOR_CONES
      dot[j] += (ROW(x, i)[j] + t * ROW(dx, i)[j]) * (ROW(z, i)[j] + t * ROW(dz, i)[j]);
    FOR_CONES total += ROW(weights, 0)[j] * dot[j];
  }
  return total;
}

/* The first row of dz, and what W^-2 takes along w, where dot is w . dx without the first row. */
static inline void eliminate(long n, double compliance, const double *restrict eta,
                             const double *restrict w_0, const double *restrict b_0,
                             const double *restrict gap_0, const double *restrict dot,
                             double *restrict dz_0, double *restrict stiffness,
                             double *restrict along)
{
  FOR_CONES
  {
    double d = 1.0 / (eta[j] * eta[j]), d_00 = (2.0 * w_0[j] * w_0[j] - 1.0) * d;
    dz_0[j] = (b_0[j] - d_00 * gap_0[j] + 2.0 * d * w_0[j] * dot[j]) / (1.0 + compliance * d_00);
    stiffness[j] = d;
    along[j] = 2.0 * (dot[j] - w_0[j] * (gap_0[j] + compliance * dz_0[j]));
  }
}

void locking_step(int rows, long count, double compliance, const double *restrict eta,
                  const double *restrict w, const double *restrict b, const double *restrict gap,
                  const double *restrict strain, double *restrict dx, double *restrict dz)
{
  FOR_CHUNKS
  {
    double dot[CHUNK] = {0.0}, stiffness[CHUNK], along[CHUNK];
    FOR_ROWS(1) FOR_CONES
    {
      ROW(dx, i)[j] = ROW(gap, i)[j] + ROW(strain, i - 1)[j];
      dot[j] += ROW(w, i)[j] * ROW(dx, i)[j];
    }
    eliminate(n, compliance, ROW(eta, 0), ROW(w, 0), ROW(b, 0), ROW(gap, 0), dot, ROW(dz, 0),
              stiffness, along);
    FOR_CONES ROW(dx, 0)[j] = ROW(gap, 0)[j] + compliance * ROW(dz, 0)[j];
    FOR_ROWS(1) FOR_CONES
      ROW(dz, i)[j] = ROW(b, i)[j] - stiffness[j] * (ROW(dx, i)[j] + along[j] * ROW(w, i)[j]);
  }
}

void locking_reactions(int rows, long count, double compliance, const double *restrict eta,
                       const double *restrict w, const double *restrict b,
                       const double *restrict gap, const double *restrict z,
                       double *restrict reactions)
{
  FOR_CHUNKS
  {
    double dot[CHUNK] = {0.0}, dz_0[CHUNK], stiffness[CHUNK], along[CHUNK];
    FOR_ROWS(1) FOR_CONES dot[j] += ROW(w, i)[j] * ROW(gap, i)[j];
    eliminate(n, compliance, ROW(eta, 0), ROW(w, 0), ROW(b, 0), ROW(gap, 0), dot, dz_0,
              stiffness, along);
    FOR_ROWS(1) FOR_CONES
      ROW(reactions, i - 1)[j] = stiffness[j] * (ROW(gap, i)[j] + along[j] * ROW(w, i)[j])
                                 - ROW(b, i)[j] - ROW(z, i)[j];
  }
}
