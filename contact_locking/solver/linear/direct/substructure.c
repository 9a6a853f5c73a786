#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

struct substructure {
  int n, interior;
  /* Bytes of a number. */
  size_t size;
  cholmod_sparse matrix;
  cholmod_common common;
  cholmod_factor *factor;
  /* Workspace of the solves, which CHOLMOD allocates once. */
  cholmod_dense *solution, *y, *e;
};

int substructure_has_its_library(void)
{
  return cholmod_version(NULL) == CHOLMOD_VERSION;
}

/* Rows of a symmetric matrix are its columns, and CHOLMOD passes over the upper triangle. */
static cholmod_sparse lower(int n, const int *starts, const int *columns, int dtype)
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
  a.dtype = dtype;
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
  cholmod_common *common = &s->common;
  cholmod_free_factor(&s->factor, common);
  cholmod_free_dense(&s->solution, common);
  cholmod_free_dense(&s->y, common);
  cholmod_free_dense(&s->e, common);
  cholmod_finish(common);
  free(s);
}

substructure *substructure_new(int n, const int *starts, const int *columns, int interior,
                               int is_single, int *order)
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
  s->size = is_single ? sizeof(float) : sizeof(double);
  s->matrix = lower(n, starts, columns, is_single ? CHOLMOD_SINGLE : CHOLMOD_DOUBLE);
  int failed = find_order(&s->matrix, interior, order, common);
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

int substructure_factorise(substructure *s, const void *values, void *corner)
{
  s->matrix.x = (void *)values;
  s->matrix.xtype = CHOLMOD_REAL;
  cholmod_factor *factor = s->factor;
  if (!cholmod_factorize(&s->matrix, factor, &s->common) || factor->minor < (size_t)s->n)
    return 1;
  const int n = s->n, interior = s->interior;
  const size_t m = n - interior, size = s->size;
  const int *super = factor->super, *starts = factor->pi, *at = factor->px, *rows = factor->s;
  memset(corner, 0, m * m * size);
  for (size_t k = 0; k < factor->nsuper; k++) {
    const int first = super[k], height = starts[k + 1] - starts[k];
    for (int j = first < interior ? interior : first; j < super[k + 1]; j++) {
      const char *column = (const char *)factor->x + (at[k] + (size_t)(j - first) * height) * size;
      for (int i = j - first; i < height; i++) {
        const size_t place = (n - 1 - j) * m + (n - 1 - rows[starts[k] + i]);
        memcpy((char *)corner + place * size, column + i * size, size);
      }
    }
  }
  return 0;
}

static int solve(substructure *s, int system, void *b)
{
  cholmod_dense right;
  memset(&right, 0, sizeof right);
  right.nrow = right.nzmax = right.d = s->n;
  right.ncol = 1;
  right.x = b;
  right.xtype = CHOLMOD_REAL;
  right.dtype = s->matrix.dtype;
  if (!cholmod_solve2(system, s->factor, &right, NULL, &s->solution, NULL, &s->y, &s->e,
            &s->common))
    return 1;
  memcpy(b, s->solution->x, s->n * s->size);
  return 0;
}

int substructure_forward(substructure *s, void *b)
{
  return solve(s, CHOLMOD_L, b);
}

int substructure_backward(substructure *s, void *b)
{
  return solve(s, CHOLMOD_Lt, b);
}
