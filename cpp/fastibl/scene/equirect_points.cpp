#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/equirect_filters.h"

namespace fastibl {
namespace {

// atan(y / x) for x, y ≥ 0, not both 0: Cephes' atanf (Moshier 1992), within 2e-7.
FASTIBL_INLINE float first_quadrant_angle(float y, float x) {
  constexpr float pi = std::numbers::pi_v<float>;
  const bool steep = y > x;
  const float ratio = steep ? x / y : y / x;
  const bool upper = ratio > 0.4142135624f;  // tan(π/8)
  const float t = upper ? (ratio - 1) / (ratio + 1) : ratio, z = t * t;
  const float p = (((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z -
                   3.33329491539e-1f) *
                      z * t +
                  t;
  const float angle = upper ? p + pi / 4 : p;
  return steep ? pi / 2 - angle : angle;
}

// Pixel positions, in units of pixels and less a half, of directions origin + a · step, a the texel
// centre's 2 s − 1.
FASTIBL_CLONES void place_row(const float* __restrict origin, const float* __restrict step,
                              float texel, int count, float width, float height,
                              float* __restrict u, float* __restrict v) {
  constexpr float pi = std::numbers::pi_v<float>;
  const float x0 = origin[0], y0 = origin[1], z0 = origin[2];
  const float dx = step[0], dy = step[1], dz = step[2];
  for (int i = 0; i < count; ++i) {
    const float a = (float(i) + 0.5f) * texel - 1;
    const float x = x0 + a * dx, y = y0 + a * dy, z = z0 + a * dz;
    const float ax = std::fabs(x), ay = std::fabs(y);
    // atan2(x, y); at the pole 0.
    const float quarter = first_quadrant_angle(ax, ay > 1e-30f ? ay : 1e-30f);
    const float half = y < 0 ? pi - quarter : quarter;
    const float azimuth = x < 0 ? -half : half;
    const float across = std::sqrt(x * x + y * y), az = std::fabs(z);
    const float off_pole = first_quadrant_angle(across, az > 1e-30f ? az : 1e-30f);
    const float polar = z < 0 ? pi - off_pole : off_pole;
    u[i] = (azimuth * (0.5f / pi) + 0.5f) * width - 0.5f;
    v[i] = polar * (1 / pi) * height - 0.5f;
  }
}

}  // namespace

void resample_points(ImageView<const float> image, CubeLevel& faces) {
  const int n = faces.size(), width = image.width, height = image.height;
  std::vector<float> u(static_cast<std::size_t>(n)), v(static_cast<std::size_t>(n));
  // Pixels are read as four floats: the very last one has no fourth.
  const float* end = image.pixel(width - 1, height - 1);
  float last[4] = {end[0], end[1], end[2], 0};
  const auto at = [&](const float* p) -> const Float4& {
    return *reinterpret_cast<const Float4*>(p == end ? last : p);
  };
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y) {
      const float t = (float(y) + 0.5f) / float(n);
      const glm::vec3 origin = face_direction(f, 0.5f, t);
      const glm::vec3 step = face_direction(f, 1, t) - origin;
      place_row(&origin.x, &step.x, 2.0f / float(n), n, float(width), float(height), u.data(),
                v.data());
      glm::vec3* out = &faces.texel(f, 0, y);
      for (int x = 0; x < n; ++x) {
        const float pu = u[std::size_t(x)],
                    pv = std::clamp(v[std::size_t(x)], 0.0f, float(height - 1));
        const int below = int(pu + 1) - 1, row = std::min(int(pv), std::max(height - 2, 0));
        const float fx = pu - float(below), fy = pv - float(row);
        const int left = below < 0 ? width - 1 : std::min(below, width - 1);
        const int right = left + 1 == width ? 0 : left + 1;
        const float* upper = image.row(row);
        const float* lower = image.row(std::min(row + 1, height - 1));
        const Float4 &a = at(upper + 3 * left), &b = at(upper + 3 * right);
        const Float4 &c = at(lower + 3 * left), &d = at(lower + 3 * right);
        const Float4 top = a + fx * (b - a), bottom = c + fx * (d - c);
        const Float4 value = top + fy * (bottom - top);
        std::memcpy(&out[x], &value, sizeof(glm::vec3));
      }
    }
}

}  // namespace fastibl
