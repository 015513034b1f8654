/* Functions without a library, callees first; of equal numbers the first is taken, as numba does,
 * and the magnitude of a zero has no sign: 0 - (-0) is +0. */


static rdpi_real rdpi_min(rdpi_real a, rdpi_real b)
{
    return (b < a) ? b : a;
}


static rdpi_real rdpi_max(rdpi_real a, rdpi_real b)
{
    return (b > a) ? b : a;
}


static int32_t rdpi_min_int(int32_t a, int32_t b)
{
    return (b < a) ? b : a;
}


static int32_t rdpi_max_int(int32_t a, int32_t b)
{
    return (b > a) ? b : a;
}


static rdpi_real rdpi_abs(rdpi_real x)
{
    return (x <= RDPI_C(0.0)) ? (RDPI_C(0.0) - x) : x;
}


static int32_t rdpi_is_nan(rdpi_real x)
{
    return (x != x) ? 1 : 0;
}


#if RDPI_PRECISION == 64
typedef uint64_t rdpi_bits;
#define RDPI_SIGN ((rdpi_bits)1u << 63)
#else
typedef uint32_t rdpi_bits;
#define RDPI_SIGN ((rdpi_bits)1u << 31)
#endif

typedef union {
    rdpi_real number;
    rdpi_bits bits;
} rdpi_image;

static rdpi_real rdpi_copysign(rdpi_real size, rdpi_real sign)
{
    rdpi_image a;
    rdpi_image b;
    a.number = size;
    b.number = sign;
    a.bits = (a.bits & ~RDPI_SIGN) | (b.bits & RDPI_SIGN);
    return a.number;
}
