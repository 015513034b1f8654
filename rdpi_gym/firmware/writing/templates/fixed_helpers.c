/* Functions of the fixed-point controllers, callees first: no 32-bit input overflows them, and negative
 * numbers are never shifted, as C99 leaves to the compiler what that does. */


/* |x|, for x above INT64_MIN. */
static uint64_t rdpi_magnitude(int64_t x)
{
    return (uint64_t)((x < 0) ? -x : x);
}


/* x / 2^shift to the nearest, halves away from zero; |x| at most 2^62, shift from 1 to 62. */
static int64_t rdpi_rounded(int64_t x, uint32_t shift)
{
    const uint32_t before = shift - 1u;
    const uint64_t half = (uint64_t)1 << before;
    const uint64_t size = (rdpi_magnitude(x) + half) >> shift;
    const int64_t whole = (int64_t)size;
    return (x < 0) ? -whole : whole;
}


static int64_t rdpi_limited(int64_t x, int64_t low, int64_t high)
{
    return (x < low) ? low : ((x > high) ? high : x);
}


/* |x| rounded, at most that of the farthest threshold. */
static uint32_t rdpi_size(int64_t x, uint32_t shift)
{
    const uint64_t size = rdpi_magnitude(rdpi_rounded(x, shift));
    return (size < UINT32_MAX) ? (uint32_t)size : UINT32_MAX;
}


/* A play x moved along to where it is no farther away than threshold + shift. */
static int32_t rdpi_slid(int32_t x, int32_t along, uint32_t threshold, uint32_t shift)
{
    uint32_t farthest = UINT32_MAX;
    int32_t slid = x;
    if (shift < (UINT32_MAX - threshold)) {
        farthest = threshold + shift;
    }
    if (x > along) {
        if (((uint32_t)x - (uint32_t)along) > farthest) {
            slid = (int32_t)((int64_t)along + (int64_t)farthest);
        }
    } else {
        if (((uint32_t)along - (uint32_t)x) > farthest) {
            slid = (int32_t)((int64_t)along - (int64_t)farthest);
        }
    }
    return slid;
}


/* x * part / 2^shift; |x| at most 2^60, part from 0 to 2^30, shift from 30 to 62. */
static int64_t rdpi_part(int64_t x, int32_t part, uint32_t shift)
{
    const uint64_t size = rdpi_magnitude(x);
    const uint64_t factor = (uint64_t)part;
    const uint64_t upper = (size >> 32) * factor;
    const uint64_t lower = (size & 0xFFFFFFFFu) * factor;
    const uint32_t more = shift - 30u;
    const uint64_t product = ((upper << 2) + (lower >> 30)) >> more;
    const int64_t whole = (int64_t)product;
    return (x < 0) ? -whole : whole;
}
