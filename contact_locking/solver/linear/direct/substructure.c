#include "substructure.h"

#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

/* Solves take so many columns of a panel together, and pass once over the rows below them. */
#define TOGETHER 4

struct substructure {
  int n, interior;
  cholmod_sparse matrix;
  cholmod_common common;
  cholmod_factor *factor;
  /* Workspace of the solves: the rows of one panel. */
  double *part;
};

/* Columns of L_I and L_GI that CHOLMOD stores together, by columns: the unknown first and those
   that follow.  The rows begin with the same unknowns. */
typedef struct panel {
  int first, width, height;
  const int *rows;
  const double *values;
} panel;

int substructure_has_its_library(void)
{
  return cholmod_version(NULL) == CHOLMOD_VERSION;
}

/* Rows of a symmetric matrix are its columns, and CHOLMOD passes over the upper triangle. */
static cholmod_sparse lower(int n, const int *starts, const int *columns)
{
  cholmod_sparse a;
  memset(&a, 0, sizeof a);
  a.nrow = a.ncol = n;
  a.nzmax = starts[n];
  a.p = (void *)starts;
  a.i = (void *)columns;
  a.stype = -1;
  a.itype = CHOLMOD_INT;
  a.xtype = CHOLMOD_PATTERN;
  a.dtype = CHOLMOD_DOUBLE;
  a.sorted = a.packed = 1;
  return a;
}

/* Puts the interior in an order that causes little fill.  Minimum degree does not foresee how much
   of it the corner brings: it takes twice the operations of nested dissection. */
static int find_order(cholmod_sparse *matrix, int interior, int *order, cholmod_common *common)
{
  /* Parts are only taken of matrices with both triangles. */
  cholmod_sparse *whole = cholmod_copy(matrix, 0, 0, common);
  cholmod_sparse *both = cholmod_submatrix(whole, order, interior, order, interior, 0, 1, common);
  cholmod_sparse *part = cholmod_copy(both, -1, 0, common);
  common->nmethods = 1;
  common->method[0].ordering = CHOLMOD_NESDIS;
  cholmod_factor *factor = cholmod_analyze(part, common);
  if (!factor) {
    /* CHOLMOD may have been built without. */
    common->nmethods = 0;
    factor = cholmod_analyze(part, common);
  }
  int *old = factor ? cholmod_malloc(interior, sizeof *old, common) : NULL;
  if (old) {
    const int *found = factor->Perm;
    memcpy(old, order, interior * sizeof *old);
    for (int k = 0; k < interior; k++)
      order[k] = old[found[k]];
  }
  const int failed = !old;
  cholmod_free(interior, sizeof *old, old, common);
  cholmod_free_factor(&factor, common);
  cholmod_free_sparse(&part, common);
  cholmod_free_sparse(&both, common);
  cholmod_free_sparse(&whole, common);
  return failed;
}

void substructure_free(substructure *s)
{
  cholmod_free_factor(&s->factor, &s->common);
  cholmod_finish(&s->common);
  free(s->part);
  free(s);
}

substructure *substructure_new(int n, const int *starts, const int *columns, int interior,
                               int *order)
{
  substructure *s = calloc(1, sizeof *s);
  if (!s)
    return NULL;
  cholmod_common *common = &s->common;
  cholmod_start(common);
  common->print = 0;
  common->supernodal = CHOLMOD_SUPERNODAL;
  s->n = n;
  s->interior = interior;
  s->matrix = lower(n, starts, columns);
  s->part = malloc(n * sizeof *s->part);
  int failed = !s->part || find_order(&s->matrix, interior, order, common);
  if (!failed) {
    /* A postorder could bring the corner forward. */
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_GIVEN;
    common->postorder = 0;
    s->factor = cholmod_analyze_p(&s->matrix, order, NULL, 0, common);
    failed = !s->factor;
  }
  if (failed) {
    substructure_free(s);
    return NULL;
  }
  return s;
}

int substructure_factorise(substructure *s, const double *values, double *lower_right)
{
  s->matrix.x = (void *)values;
  s->matrix.xtype = CHOLMOD_REAL;
  cholmod_factor *factor = s->factor;
  if (!cholmod_factorize(&s->matrix, factor, &s->common) || factor->minor < (size_t)s->n)
    return 1;
  const int n = s->n, interior = s->interior;
  const size_t m = n - interior;
  const int *super = factor->super, *starts = factor->pi, *at = factor->px, *rows = factor->s;
  memset(lower_right, 0, m * m * sizeof *lower_right);
  for (size_t k = 0; k < factor->nsuper; k++) {
    const int first = super[k], height = starts[k + 1] - starts[k];
    for (int j = first < interior ? interior : first; j < super[k + 1]; j++) {
      const double *column = (const double *)factor->x + at[k] + (size_t)(j - first) * height;
      for (int i = j - first; i < height; i++)
        lower_right[(n - 1 - j) * m + (n - 1 - rows[starts[k] + i])] = column[i];
    }
  }
  return 0;
}

/* Panel k without columns of the corner. */
static panel panel_of(const substructure *s, size_t k)
{
  const cholmod_factor *factor = s->factor;
  const int *super = factor->super, *starts = factor->pi, *at = factor->px;
  const int end = super[k + 1] < s->interior ? super[k + 1] : s->interior;
  return (panel){super[k], end - super[k], starts[k + 1] - starts[k],
                 (const int *)factor->s + starts[k], (const double *)factor->x + at[k]};
}

static int is_of_corner(const substructure *s, size_t k)
{
  return ((const int *)s->factor->super)[k] >= s->interior;
}

/* How many of the columns that are left to take together. */
static int together(int left)
{
  return left < TOGETHER ? 1 : TOGETHER;
}

/* The solves with L_I are loops of our own: those of CHOLMOD solve with L_G as well, which would have
   to be undone, and take longer for one right-hand side. */
void substructure_forward(substructure *s, double *b)
{
  for (size_t k = 0; k < s->factor->nsuper && !is_of_corner(s, k); k++) {
    const panel p = panel_of(s, k);
    const size_t height = p.height;
    double *restrict part = s->part;
    memcpy(part, b + p.first, p.width * sizeof *b);
    memset(part + p.width, 0, (height - p.width) * sizeof *b);
    for (int j = 0, count; j < p.width; j += count) {
      count = together(p.width - j);
      const double *restrict a = p.values + j * height;
      for (int c = j; c < j + count; c++) {
        const double *column = p.values + c * height;
        part[c] /= column[c];
        for (int i = c + 1; i < j + count; i++)
          part[i] -= column[i] * part[c];
      }
      const double x = part[j];
      if (count == 1) {
        for (int i = j + 1; i < p.height; i++)
          part[i] -= a[i] * x;
        continue;
      }
      const double x1 = part[j + 1], x2 = part[j + 2], x3 = part[j + 3];
      const double *restrict a1 = a + height, *restrict a2 = a1 + height, *restrict a3 = a2 + height;
      for (int i = j + TOGETHER; i < p.height; i++)
        part[i] -= a[i] * x + a1[i] * x1 + a2[i] * x2 + a3[i] * x3;
    }
    memcpy(b + p.first, part, p.width * sizeof *b);
    for (int i = p.width; i < p.height; i++)
      b[p.rows[i]] += part[i];
  }
}

void substructure_backward(substructure *s, double *b)
{
  for (size_t k = s->factor->nsuper; k-- > 0;) {
    if (is_of_corner(s, k))
      continue;
    const panel p = panel_of(s, k);
    const size_t height = p.height;
    double *restrict part = s->part;
    for (int i = 0; i < p.height; i++)
      part[i] = b[p.rows[i]];
    for (int end = p.width, j; end > 0; end = j) {
      j = end - together(end);
      const double *restrict a = p.values + j * height;
      double sum = 0, sum1 = 0, sum2 = 0, sum3 = 0;
      if (end - j == 1) {
#pragma omp simd reduction(+ : sum)
        for (int i = end; i < p.height; i++)
          sum += a[i] * part[i];
      } else {
        const double *restrict a1 = a + height, *restrict a2 = a1 + height, *restrict a3 = a2 + height;
#pragma omp simd reduction(+ : sum, sum1, sum2, sum3)
        for (int i = end; i < p.height; i++) {
          sum += a[i] * part[i];
          sum1 += a1[i] * part[i];
          sum2 += a2[i] * part[i];
          sum3 += a3[i] * part[i];
        }
      }
      const double sums[TOGETHER] = {sum, sum1, sum2, sum3};
      for (int c = end - 1; c >= j; c--) {
        const double *column = p.values + c * height;
        part[c] -= sums[c - j];
        for (int i = c + 1; i < end; i++)
          part[c] -= column[i] * part[i];
        part[c] /= column[c];
      }
    }
    memcpy(b + p.first, part, p.width * sizeof *b);
  }
}
