/* The plainest eight-sweep solver of |grad d| = 1 on a dense cube: one thread, one array, no blocks. The row that any
 * better one has to beat. Called by eikonal.py through ctypes.
 *
 * sweep(d, pinned, n): d holds seeds where pinned is set, large numbers elsewhere; distances in voxels, all positive.
 * Repeats the eight sweeps until they change nothing; returns the number of sweeps. */
#include <math.h>
#include <stdint.h>

static inline float godunov(float a, float b, float c)
{
    float t;
    if (a > b) { t = a; a = b; b = t; }
    if (b > c) { t = b; b = c; c = t; }
    if (a > b) { t = a; a = b; b = t; }
    float u = a + 1;
    if (u <= b)
        return u;
    u = 0.5f * (a + b + sqrtf(2 - (a - b) * (a - b)));
    if (u <= c)
        return u;
    float s = a + b + c, q = a * a + b * b + c * c;
    return (s + sqrtf(fmaxf(s * s - 3 * (q - 1), 0))) / 3;
}

int sweep(float *d, const uint8_t *pinned, int n)
{
    const long row = n, plane = (long)n * n;
    int sweeps = 0;
    for (;;) {
        long changed = 0;
        for (int order = 0; order < 8; order++, sweeps++) {
            int fx = order & 1, fy = order >> 1 & 1, fz = order >> 2 & 1;
            for (int k = 0; k < n; k++) {
                int z = fz ? n - 1 - k : k;
                for (int j = 0; j < n; j++) {
                    int y = fy ? n - 1 - j : j;
                    for (int i = 0; i < n; i++) {
                        int x = fx ? n - 1 - i : i;
                        long at = x + row * y + plane * z;
                        if (pinned[at])
                            continue;
                        float a = fminf(x > 0 ? d[at - 1] : INFINITY, x < n - 1 ? d[at + 1] : INFINITY);
                        float b = fminf(y > 0 ? d[at - row] : INFINITY, y < n - 1 ? d[at + row] : INFINITY);
                        float c = fminf(z > 0 ? d[at - plane] : INFINITY, z < n - 1 ? d[at + plane] : INFINITY);
                        float u = godunov(a, b, c);
                        if (u < d[at]) {
                            d[at] = u;
                            changed++;
                        }
                    }
                }
            }
        }
        if (!changed)
            return sweeps;
    }
}
