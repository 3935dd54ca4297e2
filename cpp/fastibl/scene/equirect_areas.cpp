// A texel's mean is a sum over pieces of azimuth within one column of pixels. In the middle of a
// piece the meridian crosses the texels of a face one after the other, and the rows of the picture;
// between two crossings a length in the sine of the latitude, times the piece's azimuth, is a solid
// angle. All texels share their crossings, so every part of the picture is counted once.
#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/equirect_filters.h"

namespace fastibl {
namespace {

constexpr double kPiDouble = std::numbers::pi;

struct Sum {
  Float4 flux;  // the fourth is of no meaning
  float weight;
};

// A column of pixels, walked from one pole to the other by the sine of the latitude.
class Column {
 public:
  explicit Column(ImageView<const float> image) : image_(image) {
    // Rows' upper ends; the last one is below every crossing.
    for (int y = 0; y <= image.height; ++y)
      ends_.push_back(float(std::cos(y * kPiDouble / image.height)));
    ends_.back() = -2;
    const float* end = image.pixel(image.width - 1, image.height - 1);
    for (int c = 0; c < 3; ++c) last_[c] = end[c];
    end_ = end;
  }
  // Begins at `top` in column x.
  void start(int x, float top) {
    const double row = std::acos(std::clamp(double(top), -1.0, 1.0)) / kPiDouble * image_.height;
    row_ = std::clamp(int(row), 0, image_.height - 1);
    while (row_ > 0 && ends_[std::size_t(row_)] < top) --row_;
    while (ends_[std::size_t(row_) + 1] >= top && row_ + 1 < image_.height) ++row_;
    pixel_ = image_.pixel(x, row_);
    at_ = top;
  }
  // Adds what lies between the last position and `bottom` ≤ it, times `azimuth`.
  FASTIBL_INLINE void walk(float bottom, float azimuth, Sum& sum) {
    const float from = at_;
    Float4 flux = sum.flux;
    while (ends_[std::size_t(row_) + 1] > bottom) {
      const float end = ends_[std::size_t(row_) + 1];
      flux += (azimuth * (at_ - end)) * value();
      at_ = end, ++row_, pixel_ += image_.row_stride;
    }
    sum.flux = flux + (azimuth * (at_ - bottom)) * value();
    sum.weight += azimuth * (from - bottom);
    at_ = bottom;
  }

 private:
  const Float4& value() const {  // read as four floats: the very last pixel has no fourth
    return *reinterpret_cast<const Float4*>(pixel_ == end_ ? last_ : pixel_);
  }
  ImageView<const float> image_;
  std::vector<float> ends_;
  float last_[4] = {};
  const float* end_;
  int row_ = 0;
  const float* pixel_ = nullptr;
  float at_ = 1;
};

// Columns [from, to) of the picture in pieces that lie within one pixel and are at most 1 / split
// of it. body(column of pixels, azimuth of the middle, width of the piece, both in radians)
template <typename Body>
void for_pieces(double from, double to, int width, int split, Body&& body) {
  const double to_radians = 2 * kPiDouble / width;
  for (double begin = from; begin < to - 1e-9;) {
    const double end = std::min(to, (std::floor(begin * split + 1e-7) + 1) / split);
    const double middle = 0.5 * (begin + end);
    const int column = int(std::floor(middle)) % width;
    body(column < 0 ? column + width : column, (middle / width - 0.5) * 2 * kPiDouble,
         (end - begin) * to_radians);
    begin = end;
  }
}

glm::vec3 mean(const Sum& sum) {
  return sum.weight > 0 ? glm::vec3(sum.flux[0], sum.flux[1], sum.flux[2]) / sum.weight
                        : glm::vec3(0);
}

FASTIBL_CLONES void sines(const float* __restrict heights, float cosine, int count,
                          float* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float t = heights[i] * cosine;
    out[i] = t / std::sqrt(1 + t * t);
  }
}

// The faces ±x, ±y: edges of texels are meridians one way, and the other way at a height h above
// the face's middle, of latitude atan(h cos ψ) at azimuth ψ from there.
void resample_side(ImageView<const float> image, int face, Column& column, CubeLevel& faces) {
  const int n = faces.size();
  // Azimuth atan2(x, y) of the face's middle, and its sign by the texel coordinate that it goes
  // with.
  const double middle[4] = {kPiDouble / 2, -kPiDouble / 2, 0, kPiDouble};
  const int sign[4] = {1, -1, 1, -1};
  const bool by_row = face < 2;                 // azimuth goes with t; then height goes with s
  const bool falling = face == 0 || face == 3;  // height falls with the other coordinate
  std::vector<float> heights, crossings(std::size_t(n) + 1);
  for (int k = 0; k <= n; ++k) heights.push_back(1 - 2 * float(k) / float(n));
  std::vector<Sum> line(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    std::fill(line.begin(), line.end(), Sum{});
    double ends[2];
    for (int e = 0; e < 2; ++e)
      ends[e] =
          ((middle[face] + sign[face] * std::atan(2.0 * (i + e) / n - 1)) / (2 * kPiDouble) + 0.5) *
          image.width;
    for_pieces(std::min(ends[0], ends[1]), std::max(ends[0], ends[1]), image.width, 1,
               [&](int x, double azimuth, double width) {
                 sines(heights.data(), float(std::cos(azimuth - middle[face])), n + 1,
                       crossings.data());
                 column.start(x, crossings[0]);
                 for (int k = 0; k < n; ++k)
                   column.walk(crossings[std::size_t(k) + 1], float(width), line[std::size_t(k)]);
               });
    for (int k = 0; k < n; ++k) {
      const int other = falling ? k : n - 1 - k;
      faces.texel(face, by_row ? other : i, by_row ? i : other) = mean(line[std::size_t(k)]);
    }
  }
}

// The faces ±z: a meridian is a ray from the middle. Towards the edge that it meets it crosses all
// lines of texels, between two of them at most one line of the other direction.
void resample_cap(ImageView<const float> image, int face, Column& column, CubeLevel& faces) {
  const int n = faces.size();
  const bool top = face == 4;
  // Rays are as dense that several meet every texel at the edge.
  const int split = std::max(1, int(std::ceil(16.0 * n / image.width)));
  std::vector<Sum> sums(std::size_t(n) * std::size_t(n));
  struct Crossing {
    float along;  // the ray's coordinate towards the edge
    int index;    // of the texel that follows
  };
  std::vector<Crossing> path;
  std::vector<float> along, height;
  for_pieces(0, image.width, image.width, split, [&](int x, double azimuth, double width) {
    // Coordinates on the face, a to the right and b down, per unit of distance from the middle.
    const double east = std::sin(azimuth), north = std::cos(azimuth);
    const double a = top ? east : -east, b = -north;
    const bool by_a = std::abs(a) > std::abs(b);
    const double major = by_a ? a : b, minor = by_a ? b : a;
    const float slope = float(minor / std::abs(major)), cosine = float(std::abs(major));
    const auto texel = [n](float c) {
      return std::clamp(int((c + 1) * 0.5f * float(n)), 0, n - 1);
    };
    path.clear();
    const int first = major > 0 ? n / 2 : (n - 1) / 2, step = major > 0 ? 1 : -1;
    int across = texel(slope > 0 ? 1e-6f : -1e-6f), i = first;
    const int across_step = slope > 0 ? 1 : -1;
    const auto next_line = [&](int cell, int direction) {
      return direction * (2 * float(cell + (direction > 0)) / float(n) - 1);
    };
    const float steep = std::abs(slope) > 1e-12f ? 1 / std::abs(slope) : 1e30f;
    while (i >= 0 && i < n) {
      const float edge = std::abs(next_line(i, step));
      float side = std::abs(next_line(across, across_step)) * steep;
      while (side < edge && across + across_step >= 0 && across + across_step < n) {
        path.push_back({side, by_a ? across * n + i : i * n + across});
        across += across_step;
        side = std::abs(next_line(across, across_step)) * steep;
      }
      path.push_back({edge, by_a ? across * n + i : i * n + across});
      i += step;
    }
    // Sine of the latitude c / √(c² + X²) at X towards the edge.
    along.resize(path.size()), height.resize(path.size());
    for (std::size_t k = 0; k < path.size(); ++k) along[k] = path[k].along;
    for (std::size_t k = 0; k < path.size(); ++k) {
      const float s = cosine / std::sqrt(cosine * cosine + along[k] * along[k]);
      height[k] = top ? s : -s;
    }
    if (top) {
      column.start(x, 1);
      for (std::size_t k = 0; k < path.size(); ++k)
        column.walk(height[k], float(width), sums[std::size_t(path[k].index)]);
    } else {
      column.start(x, height.back());
      for (std::size_t k = path.size(); k-- > 0;)
        column.walk(k > 0 ? height[k - 1] : -1, float(width), sums[std::size_t(path[k].index)]);
    }
  });
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x)
      faces.texel(face, x, y) = mean(sums[std::size_t(y) * std::size_t(n) + std::size_t(x)]);
}

}  // namespace

void resample_areas(ImageView<const float> image, CubeLevel& faces) {
  Column column(image);
  for (int face = 0; face < 4; ++face) resample_side(image, face, column, faces);
  for (int face = 4; face < 6; ++face) resample_cap(image, face, column, faces);
}

}  // namespace fastibl
