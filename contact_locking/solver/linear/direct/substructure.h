/* One substructure: an interior that CHOLMOD eliminates, and a corner of unknowns that it shares
   with others.  With the interior first, P A P^T = L L^T.  Functions return 0, or 1 where CHOLMOD
   gives up; the arrays of the pattern have to outlive the substructure. */

typedef struct substructure substructure;

/* Whether the CHOLMOD at hand is that of the header; a process may have loaded another before. */
int substructure_has_its_library(void);

/* A symmetric matrix by rows: those of row k begin at starts[k], in ascending columns.  NULL where
   there is no memory.  order (n) holds the numbers of the interior, then those of the corner; the
   former are put in the order in which they are eliminated. */
substructure *substructure_new(int n, const int *starts, const int *columns, int interior,
                               int is_single, int *order);
void substructure_free(substructure *s);

/* Factorises; corner (m, m), by columns, gets the corner of L with its rows and columns in reverse
   order, which makes it upper triangular. */
int substructure_factorise(substructure *s, const void *values, void *corner);

/* L^-1 b, and L^-T b, in place. */
int substructure_forward(substructure *s, void *b);
int substructure_backward(substructure *s, void *b);
