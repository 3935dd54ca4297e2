#include <cmath>
#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/arctangent.h"
#include "fastibl/scene/equirect_filters.h"

namespace fastibl {
namespace {

// Where a row of texels lies in the picture: the pixel columns to both sides, the upper pixel row,
// and the share of the way to the right and lower ones.
struct Places {
  explicit Places(std::size_t n) : left(n), right(n), upper(n), fx(n), fy(n) {}
  std::vector<int> left, right, upper;
  std::vector<float> fx, fy;
};

// Of directions origin + a · step, where a is the texel centre's 2 s − 1.
FASTIBL_CLONES void place_row(const float* __restrict origin, const float* __restrict step,
                              int count, int width, int height, int* __restrict left,
                              int* __restrict right, int* __restrict upper, float* __restrict fx,
                              float* __restrict fy) {
  constexpr float pi = std::numbers::pi_v<float>;
  const float x0 = origin[0], y0 = origin[1], z0 = origin[2];
  const float dx = step[0], dy = step[1], dz = step[2];
  const float texel = 2 / float(count), columns = float(width), rows = float(height);
  const int last_upper = height > 1 ? height - 2 : 0;
  for (int i = 0; i < count; ++i) {
    const float a = (float(i) + 0.5f) * texel - 1;
    const float x = x0 + a * dx, y = y0 + a * dy, z = z0 + a * dz;
    const float ax = std::fabs(x), ay = std::fabs(y);
    // atan2(x, y); 0 at the pole.
    const float quarter = first_quadrant_angle(ax, ay > 1e-30f ? ay : 1e-30f);
    const float half = y < 0 ? pi - quarter : quarter;
    const float azimuth = x < 0 ? -half : half;
    const float across = std::sqrt(x * x + y * y), az = std::fabs(z);
    const float off_pole = first_quadrant_angle(across, az > 1e-30f ? az : 1e-30f);
    const float polar = z < 0 ? pi - off_pole : off_pole;
    const float u = (azimuth * (0.5f / pi) + 0.5f) * columns - 0.5f;
    float v = polar * (1 / pi) * rows - 0.5f;
    v = v > 0 ? (v < rows - 1 ? v : rows - 1) : 0.0f;
    const int column = int(u + 1) - 1;
    const int row = int(v) < last_upper ? int(v) : last_upper;
    const float past = u - float(column);  // below 0 where u + 1 was rounded up
    fx[i] = past > 0 ? past : 0.0f, fy[i] = v - float(row), upper[i] = row;
    left[i] = column < 0 ? width - 1 : (column < width ? column : width - 1);
    right[i] = column + 1 < width ? column + 1 : 0;
  }
}

// Pixels are read as four floats; `end`, the very last one, has no fourth, so `copy` holds it too.
FASTIBL_CLONES void look_up_row(const float* image, std::ptrdiff_t row_stride, std::ptrdiff_t below,
                                const float* end, const float* copy, const int* left,
                                const int* right, const int* upper, const float* fx,
                                const float* fy, int count, float* out) {
  const float after[1] = {out[3 * count]};
  for (int i = 0; i < count; ++i, out += 3) {
    const float* row = image + upper[i] * row_stride;
    const float *p = row + 3 * left[i], *q = row + 3 * right[i];
    const float *r = p + below, *s = q + below;
    r = r == end ? copy : r, s = s == end ? copy : s;
    if (below == 0) p = r, q = s;
    const Float4 &a = *reinterpret_cast<const Float4*>(p), &b = *reinterpret_cast<const Float4*>(q);
    const Float4 &c = *reinterpret_cast<const Float4*>(r), &d = *reinterpret_cast<const Float4*>(s);
    const Float4 top = a + fx[i] * (b - a), bottom = c + fx[i] * (d - c);
    // Also writes into the next texel, which is written next.
    *reinterpret_cast<Float4*>(out) = top + fy[i] * (bottom - top);
  }
  out[0] = after[0];
}

}  // namespace

void resample_points(ImageView<const float> image, CubeLevel& faces) {
  const int n = faces.size();
  Places places{std::size_t(n)};
  const float* end = image.pixel(image.width - 1, image.height - 1);
  const float copy[4] = {end[0], end[1], end[2], 0};
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y) {
      const float t = (float(y) + 0.5f) / float(n);
      const glm::vec3 origin = face_direction(f, 0.5f, t);
      const glm::vec3 step = face_direction(f, 1, t) - origin;
      place_row(&origin.x, &step.x, n, image.width, image.height, places.left.data(),
                places.right.data(), places.upper.data(), places.fx.data(), places.fy.data());
      look_up_row(image.data, image.stride(), image.height > 1 ? image.stride() : 0, end, copy,
                  places.left.data(), places.right.data(), places.upper.data(), places.fx.data(),
                  places.fy.data(), n, &faces.texel(f, 0, y).x);
    }
}

}  // namespace fastibl
