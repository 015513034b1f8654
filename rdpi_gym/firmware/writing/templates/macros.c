@IF_NAN@
#define RDPI_NAN ((rdpi_real)NAN)
@END_NAN@
@IF_INFINITY@
#define RDPI_INFINITY ((rdpi_real)INFINITY)
@END_INFINITY@
@IF_OVER@
/* By a constant: divided in double, as Python does; else multiplied, which is faster. */
#if RDPI_PRECISION == 64 && !defined(RDPI_NO_DIVISION)
#define RDPI_OVER(x, d) ((x) / (d))
#else
#define RDPI_OVER(x, d) ((x) * (RDPI_C(1.0) / (d)))
#endif
@END_OVER@
@IF_WIDE@
/* What a float cannot hold: the first in double, the second in float. */
#if RDPI_PRECISION == 64
#define RDPI_WIDE(x, f) (x)
#else
#define RDPI_WIDE(x, f) (f)
#endif
@END_WIDE@
