/* One substructure: an interior that CHOLMOD eliminates, and a corner of unknowns that it shares
   with others.  With the interior first,

       P A P^T = [ A_I   A_IG ] = L L^T,    L = [ L_I       ]
                 [ A_GI  A_GG ]                 [ L_GI  L_G ].

   Functions return 0, or 1 where CHOLMOD gives up; the arrays of the pattern have to outlive the
   substructure. */

typedef struct substructure substructure;

/* Whether the CHOLMOD at hand is that of the header; a process may have loaded another before. */
int substructure_has_its_library(void);

/* A symmetric matrix by rows: those of row k begin at starts[k], in ascending columns.  NULL where
   there is no memory.  order (n) holds the numbers of the interior, then those of the corner; the
   former are put in the order in which they are eliminated. */
substructure *substructure_new(int n, const int *starts, const int *columns, int interior,
                               int *order);
void substructure_free(substructure *s);

/* Factorises; corner (m, m), by columns, gets L_G with its rows and columns in reverse order, which
   makes it upper triangular. */
int substructure_factorise(substructure *s, const double *values, double *corner);

/* (b_I, b_G) becomes (L_I^-1 b_I, b_G - L_GI L_I^-1 b_I). */
void substructure_forward(substructure *s, double *b);
/* (b_I, b_G) becomes (L_I^-T (b_I - L_GI^T b_G), b_G). */
void substructure_backward(substructure *s, double *b);
