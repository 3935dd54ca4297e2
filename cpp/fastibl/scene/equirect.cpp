#include "fastibl/scene/equirect.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/equirect_filters.h"

namespace fastibl {
namespace {

constexpr int kMostHeight = 1 << 13;  // 2^27 pixels

// Directions of a grid of `count` columns over the full turn: x = sin, y = cos of the azimuth.
struct Azimuths {
  std::vector<float> sine, cosine;
  explicit Azimuths(int count) : sine(std::size_t(count)), cosine(std::size_t(count)) {
    for (int i = 0; i < count; ++i) {
      const double a = ((i + 0.5) / count - 0.5) * 2 * std::numbers::pi;
      sine[std::size_t(i)] = float(std::sin(a)), cosine[std::size_t(i)] = float(std::cos(a));
    }
  }
};

// A thin ring of constant height: sine and cosine of its mid polar angle, and its exact solid angle
// per column: ∫ sin θ dθ dφ = (cos θ0 − cos θ1) Δφ, written as a product to keep the digits near
// the poles.
struct Ring {
  float sine, cosine;
  double solid_angle;
  Ring(int row, int rows, int columns) {
    const double step = std::numbers::pi / rows, middle = (row + 0.5) * step;
    sine = float(std::sin(middle)), cosine = float(std::cos(middle));
    solid_angle = 2 * std::sin(middle) * std::sin(0.5 * step) * 2 * std::numbers::pi / columns;
  }
};

// Scales each channel so that the total is the given one. It is off by a few 1e-4 before, because
// pieces are points.
void keep_energy(std::vector<glm::vec3>& values, const glm::dvec3& have, const glm::dvec3& want) {
  glm::vec3 scale(1);
  for (int c = 0; c < 3; ++c)
    if (have[c] > 0 && want[c] > 0) scale[c] = float(want[c] / have[c]);
  for (glm::vec3& value : values) value *= scale;
}

}  // namespace

namespace {

// The picture's light, ∫ L dω, in double.
glm::dvec3 light_of(ImageView<const float> image) {
  glm::dvec3 total(0);
  for (int y = 0; y < image.height; ++y) {
    const float* row = image.row(y);
    glm::dvec3 sum[4] = {};  // side by side: additions do not wait for each other
    int x = 0;
    for (; x + 4 <= image.width; x += 4)
      for (int k = 0; k < 4; ++k, row += 3) sum[k] += glm::dvec3(row[0], row[1], row[2]);
    for (; x < image.width; ++x, row += 3) sum[0] += glm::dvec3(row[0], row[1], row[2]);
    total += Ring(y, image.height, image.width).solid_angle * (sum[0] + sum[1] + (sum[2] + sum[3]));
  }
  return total;
}

// The picture with clean values: itself, or a copy.
ImageView<const float> cleaned(ImageView<const float> image, Image<float>& copy,
                               CleaningStatistics& statistics) {
  bool clean = image.stride() > 0;  // pixels are read as four floats, but for the last one's
  for (int y = 0; y < image.height && clean; ++y) clean = all_clean(image.row(y), 3 * image.width);
  if (clean) return image;
  copy = Image<float>(image.width, image.height, 3);
  for (int y = 0; y < image.height; ++y)
    for (int i = 0; i < 3 * image.width; ++i)
      copy.row(y)[i] = clean_radiance(image.row(y)[i], statistics);
  return std::as_const(copy).view();
}

}  // namespace

CubeMap cubemap_from_equirect(ImageView<const float> image, int size, EquirectFilter filter) {
  check(!image.empty(), "an equirectangular picture must not be empty");
  check(image.channels == 3, "an equirectangular picture needs 3 channels, got ", image.channels);
  check_rows(image, "an equirectangular picture");
  check(size >= 1, "faces must be at least 1 texel wide, got ", size);
  Image<float> copy;
  CleaningStatistics statistics;
  const ImageView<const float> clean = cleaned(image, copy, statistics);
  CubeMap cube(size);
  if (filter == EquirectFilter::point) {
    resample_points(clean, cube.base());
  } else {
    resample_areas(clean, cube.base());
    // The total is off by a few 1e-6, because a piece's edges are straight. Beside suns,
    // differences of sums may fall below 0.
    const glm::dvec3 want = light_of(clean), have = cube.mean() * (4 * std::numbers::pi);
    glm::vec3 scale(1);
    for (int c = 0; c < 3; ++c)
      if (have[c] > 0 && want[c] > 0) scale[c] = float(want[c] / have[c]);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < size; ++y) {
        glm::vec3* row = &cube.base().texel(f, 0, y);
        for (int x = 0; x < size; ++x)
          row[x] = glm::clamp(row[x] * scale, glm::vec3(0), glm::vec3(kRadianceCap));
      }
  }
  cube.update();
  cube.set_cleaned(statistics);
  return cube;
}

Image<float> equirect_from_cubemap(const CubeMap& cube, int height) {
  check(height >= 1 && height <= kMostHeight,
        "the height of an equirectangular picture must be 1 to ", kMostHeight, ", got ", height);
  const int width = 2 * height;
  const int n = cube.size();
  check(n > 0, "an empty map has no picture");
  const int split = std::max(2, int(std::ceil(6 * (std::numbers::pi / height) / (2.0 / n) / 2)));
  const Azimuths azimuth(width * split);
  const CubeLevel& base = cube.level(0);
  std::vector<glm::vec3> pixels(std::size_t(width) * height);
  std::vector<glm::dvec3> row_sum(static_cast<std::size_t>(height), glm::dvec3(0));
  parallel_for(height, 4, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      std::vector<glm::dvec3> sums(std::size_t(width), glm::dvec3(0));
      double angle = 0;
      for (int sub = 0; sub < split; ++sub) {
        const Ring ring(y * split + sub, height * split, width * split);
        angle += ring.solid_angle * split;
        for (int x = 0; x < width; ++x)
          for (int i = x * split; i < (x + 1) * split; ++i) {
            const TexelPlace at =
                texel_at(glm::vec3(ring.sine * azimuth.sine[std::size_t(i)],
                                   ring.sine * azimuth.cosine[std::size_t(i)], ring.cosine),
                         n);
            sums[std::size_t(x)] += ring.solid_angle * glm::dvec3(base.texel(at.face, at.x, at.y));
          }
      }
      for (int x = 0; x < width; ++x) {
        row_sum[std::size_t(y)] += sums[std::size_t(x)];
        pixels[std::size_t(y) * width + std::size_t(x)] = glm::vec3(sums[std::size_t(x)] / angle);
      }
    }
  });
  glm::dvec3 have(0);
  for (const glm::dvec3& sum : row_sum) have += sum;
  keep_energy(pixels, have, cube.mean() * (4 * std::numbers::pi));
  Image<float> image(width, height, 3);
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (int c = 0; c < 3; ++c) image.data[3 * i + std::size_t(c)] = pixels[i][c];
  return image;
}

}  // namespace fastibl
