/* Lorentz cones by the batch: points are [rows][count], one value for each cone is [count].
   lorentz.py says what the names mean. */

/* size = sqrt(det x) */
void lorentz_size(int rows, long count, const double *x, double *size);

/* The scaling point w, eta and lambda = W z = W^-1 x. */
void lorentz_scaling(int rows, long count, const double *x, const double *z, const double *size_x,
                     const double *size_z, double *eta, double *w, double *lambda);

/* b = target x^-1 - z - W^-1 y with lambda o y = correction, which may be NULL */
void lorentz_aim(int rows, long count, double target, const double *x, const double *z,
                 const double *size_x, const double *size_z, const double *eta, const double *w,
                 const double *lambda, const double *correction, double *b);

/* product = W^-1 (x + t dx) o W (z + t dz) */
void lorentz_product(int rows, long count, double t, const double *x, const double *z,
                     const double *dx, const double *dz, const double *eta, const double *w,
                     double *product);

/* change = what takes the eigenvalues of product into [low, high], and no more than high down */
void lorentz_into_band(int rows, long count, double low, double high, const double *product,
                       double *change);

/* The largest 1/t with x + t (dx + share (other - dx)) on the boundary of a cone, negative or zero if
   there is none, and no number if one of the steps is none.  Unless speeds is null, each of its
   entries becomes at least that of its cone. */
double lorentz_speed(int rows, long count, double share, const double *x, const double *size,
                     const double *dx, const double *other, double *speeds);

/* The sum of weights (x + t dx) . (z + t dz) */
double lorentz_total(int rows, long count, double t, const double *weights, const double *x,
                     const double *z, const double *dx, const double *dz);

/* dz = b - W^-2 dx with dx = gap + (compliance dz_0, strain) */
void locking_step(int rows, long count, double compliance, const double *eta, const double *w,
                  const double *b, const double *gap, const double *strain, double *dx,
                  double *dz);

/* The rows of -(z + dz) below the first, with the dz of locking_step for a strain of zero. */
void locking_reactions(int rows, long count, double compliance, const double *eta, const double *w,
                       const double *b, const double *gap, const double *z, double *reactions);
