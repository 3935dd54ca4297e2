#include "fastibl/scene/equirect.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

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
// per column: ∫ sin θ dθ dφ = (cos θ0 − cos θ1) Δφ, as a product to keep the digits near the poles.
struct Ring {
  float sine, cosine;
  double solid_angle;
  Ring(int row, int rows, int columns) {
    const double step = std::numbers::pi / rows, middle = (row + 0.5) * step;
    sine = float(std::sin(middle)), cosine = float(std::cos(middle));
    solid_angle = 2 * std::sin(middle) * std::sin(0.5 * step) * 2 * std::numbers::pi / columns;
  }
};

// Scale each channel so that the total is the given one. Departures are a few 1e-4: pieces are
// points.
void keep_energy(std::vector<glm::vec3>& values, const glm::dvec3& have, const glm::dvec3& want) {
  glm::vec3 scale(1);
  for (int c = 0; c < 3; ++c)
    if (have[c] > 0 && want[c] > 0) scale[c] = float(want[c] / have[c]);
  for (glm::vec3& value : values) value *= scale;
}

}  // namespace

CubeMap cubemap_from_equirect(ImageView<const float> image, int size) {
  check(!image.empty(), "an equirectangular picture must not be empty");
  check(image.channels == 3, "an equirectangular picture needs 3 channels, got ", image.channels);
  check(size >= 1, "faces must be at least 1 texel wide, got ", size);
  // Pieces per pixel and axis: 6 where pixel and texel are alike, more where pixels are larger, so
  // that every texel receives several.
  const double texel = 2.0 / size, pixel_x = 2 * std::numbers::pi / image.width,
               pixel_y = std::numbers::pi / image.height;
  const int split_x = std::max(2, int(std::ceil(6 * pixel_x / texel)));
  const int split_y = std::max(2, int(std::ceil(6 * pixel_y / texel)));
  const int columns = image.width * split_x, rows = image.height * split_y;
  const Azimuths azimuth(columns);

  // Each block of picture rows fills its own sums; they are added in order, so that the result does
  // not depend on the number of threads.
  const std::size_t count = 6 * std::size_t(size) * std::size_t(size);
  std::vector<glm::dvec3> flux(count, glm::dvec3(0));
  std::vector<double> weight(count, 0);
  glm::dvec3 total(0);
  CleaningStatistics ignored;
  for (int y = 0; y < image.height; ++y) {
    std::vector<glm::dvec3> line(std::size_t(image.width));
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < 3; ++c)
        line[std::size_t(x)][c] = clean_radiance(image.pixel(x, y)[c], ignored);
    for (int sub = 0; sub < split_y; ++sub) {
      const Ring ring(y * split_y + sub, rows, columns);
      for (int x = 0; x < image.width; ++x) {
        const glm::dvec3 part = line[std::size_t(x)] * ring.solid_angle;
        total += part * double(split_x);
        for (int i = x * split_x; i < (x + 1) * split_x; ++i) {
          const FacePoint p = face_point({ring.sine * azimuth.sine[std::size_t(i)],
                                          ring.sine * azimuth.cosine[std::size_t(i)], ring.cosine});
          const int tx = std::clamp(int(p.s * float(size)), 0, size - 1);
          const int ty = std::clamp(int(p.t * float(size)), 0, size - 1);
          const std::size_t k =
              (std::size_t(p.face) * size + std::size_t(ty)) * size + std::size_t(tx);
          flux[k] += part;
          weight[k] += ring.solid_angle;
        }
      }
    }
  }
  std::vector<glm::vec3> faces(count);
  const std::vector<double> angle = texel_solid_angles(size);
  glm::dvec3 kept(0);
  for (std::size_t k = 0; k < count; ++k) {
    faces[k] = weight[k] > 0 ? glm::vec3(flux[k] / weight[k]) : glm::vec3(0);
    kept += angle[k % angle.size()] * glm::dvec3(faces[k]);
  }
  keep_energy(faces, kept, total);
  return CubeMap(size, faces);
}

Image<float> equirect_from_cubemap(const CubeMap& cube, int height) {
  check(height >= 1, "the height of an equirectangular picture must be at least 1, got ", height);
  const int width = 2 * height;
  const int n = cube.size();
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
            const FacePoint p =
                face_point({ring.sine * azimuth.sine[std::size_t(i)],
                            ring.sine * azimuth.cosine[std::size_t(i)], ring.cosine});
            sums[std::size_t(x)] +=
                ring.solid_angle *
                glm::dvec3(base.texel(p.face, std::min(int(p.s * float(n)), n - 1),
                                      std::min(int(p.t * float(n)), n - 1)));
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
