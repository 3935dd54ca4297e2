// The sum over a folded map at eight nodes of an octant; see core/wide.h for how it is compiled.

#include "fastibl/core/wide.inl"

FASTIBL_INLINE void sharpen(Wide& cosine, float reach, float sharpening) {
  const Wide none = {}, limit = none + reach;
  const Wide h = cosine < none ? -cosine : cosine;
  const Wide cut = limit - (h < limit ? h : limit);
  cosine = h - sharpening * cut * cut;
}

// sums: kRows of eight. For a node and a texel, the four |cos| with the texel's images in nothing, x,
// y and z are combined by the sign patterns: a fourth of the products of a sum over half the sphere.
FASTIBL_TARGET void sum_sources(const Source* sources, int count, const float* nx, const float* ny,
                                const float* nz, float* sums) {
  Wide x, y, z;
  std::memcpy(&x, nx, sizeof x), std::memcpy(&y, ny, sizeof y), std::memcpy(&z, nz, sizeof z);
  Wide sum[kRows] = {};
  for (int j = 0; j < count; ++j) {
    const Source& s = sources[j];
    const Wide a = x * s.x, b = y * s.y, c = z * s.z;
    const Wide more = a + b, less = a - b;
    Wide k0 = more + c, k1 = c - less, k2 = c + less, k3 = more - c;
    sharpen(k0, s.reach, s.sharpening);
    sharpen(k1, s.reach, s.sharpening);
    sharpen(k2, s.reach, s.sharpening);
    sharpen(k3, s.reach, s.sharpening);
    const Wide u = k0 + k1, v = k2 + k3, w = k0 - k1, r = k2 - k3;
    const Wide one = u + v, yz = u - v, xz = w + r, xy = w - r;
    for (int k = 0; k < 3; ++k) {
      sum[k] = multiply_add(one, repeat(s.light[0][k]), sum[k]);
      sum[3 + k] = multiply_add(yz, repeat(s.light[1][k]), sum[3 + k]);
      sum[6 + k] = multiply_add(xz, repeat(s.light[2][k]), sum[6 + k]);
      sum[9 + k] = multiply_add(xy, repeat(s.light[3][k]), sum[9 + k]);
    }
    sum[12] += one;
  }
  std::memcpy(sums, sum, sizeof sum);
}

#undef FASTIBL_INLINE
