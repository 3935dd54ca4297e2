// The sum over a folded map at eight nodes of an octant; see core/wide.h for how it is compiled.

#include <cstring>

#include "fastibl/core/wide.inl"

FASTIBL_KERNEL_INLINE void sharpen(Wide& cosine, float reach, float sharpening) {
  const Wide limit = repeat(reach), h = larger(cosine, -cosine), cut = limit - smaller(h, limit);
  cosine = h - repeat(sharpening) * cut * cut;
}

// sums: kRows of eight. For a node and a texel, the four |cos| with the texel's images in nothing,
// x, y and z are combined by the sign patterns: a fourth of the products of a sum over half the
// sphere.
FASTIBL_TARGET void sum_sources(const Source* sources, int count, const float* nx, const float* ny,
                                const float* nz, float* sums) {
  Wide x, y, z;
  std::memcpy(&x, nx, sizeof x), std::memcpy(&y, ny, sizeof y), std::memcpy(&z, nz, sizeof z);
  constexpr int kPart = 64;  // texels that are summed by themselves: rounding stays below 1e-6
  Wide total[kRows] = {};
  for (int begin = 0; begin < count; begin += kPart) {
    Wide sum[kRows] = {};
    for (int j = begin; j < count && j < begin + kPart; ++j) {
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
    for (int r = 0; r < kRows; ++r) total[r] += sum[r];
  }
  std::memcpy(sums, total, sizeof total);
}

// What point lights send to eight nodes: sums is kPointRows of eight, channels within images.
FASTIBL_TARGET void sum_points(const PointLight* points, int count, const float* nx, const float* ny,
                              const float* nz, float* sums) {
  Wide x, y, z;
  std::memcpy(&x, nx, sizeof x), std::memcpy(&y, ny, sizeof y), std::memcpy(&z, nz, sizeof z);
  Wide total[kPointRows] = {};
  for (int i = 0; i < count; ++i) {
    const PointLight& s = points[i];
    const Wide a = x * s.x, b = y * s.y, c = z * s.z;
    const Wide more = a + b, less = a - b;
    const Wide images[4] = {more + c, c - less, c + less, more - c};
    for (int k = 0; k < 4; ++k)
      for (int channel = 0; channel < 3; ++channel)
        total[3 * k + channel] =
            multiply_add(larger(images[k], -images[k]), repeat(s.half_flux[channel]),
                         total[3 * k + channel]);
  }
  std::memcpy(sums, total, sizeof total);
}
