#include "fastibl/lighting/lobe_filter.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

struct Texel {
  int face, x, y;  // face < 0: nothing is there
};

// The texel at (x, y) of a face with its margin. Past an edge it is the neighbour's texel at the
// same place along the edge and as deep.
Texel padded_texel(int face, int x, int y, int n) {
  const bool out_x = x < 0 || x >= n, out_y = y < 0 || y >= n;
  if (!out_x && !out_y) return {face, x, y};
  if (out_x && out_y) return {-1, 0, 0};
  const float past = 1e-4f / float(n);
  const auto place = [&](int i) {
    return std::clamp((float(i) + 0.5f) / float(n), -past, 1 + past);
  };
  const int depth = x < 0 ? -1 - x : x >= n ? x - n : y < 0 ? -1 - y : y - n;
  const FacePoint p = face_point(face_direction(face, place(x), place(y)));
  const int i = texel_at(p, n).x, j = texel_at(p, n).y;
  const float edge = std::min(std::min(p.s, 1 - p.s), std::min(p.t, 1 - p.t));
  if (p.s == edge) return {p.face, depth, j};
  if (1 - p.s == edge) return {p.face, n - 1 - depth, j};
  if (p.t == edge) return {p.face, i, depth};
  return {p.face, i, n - 1 - depth};
}

glm::dvec3 unit_direction(const Texel& t, int n) {
  return glm::normalize(glm::dvec3(texel_direction(t.face, t.x, t.y, n)));
}

// The exponent whose lobe, sampled with texels of these solid angles and read bilinearly, is as
// wide as that of `exponent`: a box of variance 1/12 and a tent of 1/6 texels blur it.
double sharpened(double exponent, double source_texel, double target_texel) {
  const double variance = 4 / exponent;
  return 4 / std::max(variance - source_texel / 12 - target_texel / 6, 0.25 * variance);
}

double lobe(double cosine, double exponent) {
  return cosine > 0 ? cosine * std::pow(0.5 * (1 + cosine), 0.5 * exponent) : 0;
}

// targets × 24 sums of weighted blocks, run by run: partial sums keep the rounding small.
typedef float Eight __attribute__((vector_size(32), aligned(4)));

FASTIBL_CLONES
void sum_runs(const float* blocks, const std::int32_t* runs, const std::int32_t* begin,
              const std::int32_t* weight_begin, const float* weights, int first, int last,
              float* out) {
  for (int i = first; i < last; ++i) {
    Eight sum0{}, sum1{}, sum2{};
    const float* w = weights + weight_begin[i];
    for (int r = begin[i]; r < begin[i + 1]; ++r) {
      const Eight* block =
          reinterpret_cast<const Eight*>(blocks + std::ptrdiff_t(runs[2 * r]) * 24);
      Eight part0{}, part1{}, part2{};
      for (int k = runs[2 * r + 1]; k > 0; --k, block += 3, ++w) {
        part0 += *w * block[0];
        part1 += *w * block[1];
        part2 += *w * block[2];
      }
      sum0 += part0, sum1 += part1, sum2 += part2;
    }
    Eight* to = reinterpret_cast<Eight*>(out + std::ptrdiff_t(i - first) * 24);
    to[0] = sum0, to[1] = sum1, to[2] = sum2;
  }
}

// out[t] += Σ_s w[s][t] in[s] for three channels one after the other, 16 sources at a time.
FASTIBL_CLONES
void sum_all(const float* weights, const float* in, int sources, int targets, float* part,
             float* out) {
  for (int s = 0; s < sources; s += 16) {
    for (int t = 0; t < 3 * targets; ++t) part[t] = 0;
    for (int k = s; k < s + 16 && k < sources; ++k)
      for (int c = 0; c < 3; ++c) {
        const float value = in[3 * k + c];
        const float* w = weights + std::ptrdiff_t(k) * targets;
        float* to = part + c * targets;
        for (int t = 0; t < targets; ++t) to[t] += w[t] * value;
      }
    for (int t = 0; t < 3 * targets; ++t) out[t] += part[t];
  }
}

}  // namespace

namespace {

// Where the margins of all faces come from: (texel in the level, float in the blocks) pairs.
struct Margin {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> copies;
  explicit Margin(int n) {
    const CubeLevel level(n);
    const int d = PaddedFaces::margin(n), row = n + 2 * d;
    for (int f = 0; f < 6; ++f)
      for (int y = -d; y < n + d; ++y)
        for (int x = -d; x < n + d; ++x) {
          const Texel t = padded_texel(f, x, y, n);
          if (t.face < 0 || (x >= 0 && x < n && y >= 0 && y < n)) continue;
          copies.emplace_back(std::uint32_t(&level.texel(t.face, t.x, t.y) - level.face(0)),
                              std::uint32_t(((y + d) * row + x + d) * PaddedFaces::kBlock + 3 * f));
        }
  }
};

const Margin& margin_of(int size) {
  static const Margin large(64), middle(32), small(16);
  return size == 64 ? large : size == 32 ? middle : small;
}

}  // namespace

PaddedFaces::PaddedFaces(const CubeLevel& level) : size_(level.size()) {
  check(size_ == 64 || size_ == 32 || size_ == 16, "faces of 16, 32 or 64 texels, got ", size_);
  const int n = size_, d = margin(n), row = n + 2 * d;
  blocks_.assign(std::size_t(row) * std::size_t(row) * kBlock, 0.0f);
  for (int y = 0; y < n; ++y) {
    float* to = &blocks_[(std::size_t(y + d) * std::size_t(row) + std::size_t(d)) * kBlock];
    const glm::vec3* from = &level.texel(0, 0, y);
    for (int x = 0; x < n; ++x, ++from, to += kBlock)
      for (int f = 0; f < 6; ++f) std::memcpy(to + 3 * f, from + f * level.face_stride(), 12);
  }
  const glm::vec3* first = level.face(0);
  for (const auto& [from, to] : margin_of(n).copies)
    std::memcpy(&blocks_[to], first + from, sizeof(glm::vec3));
}

LobeFilter::LobeFilter(int size, float exponent) : size_(size) {
  const int n = size, d = PaddedFaces::margin(n), row = n + 2 * d;
  const std::vector<double> angles = texel_solid_angles(n);
  // Directions and solid angles of everything around face 0.
  std::vector<glm::dvec3> directions(std::size_t(row) * std::size_t(row));
  std::vector<double> solid(directions.size(), 0.0);
  for (int y = -d; y < n + d; ++y)
    for (int x = -d; x < n + d; ++x) {
      const Texel t = padded_texel(0, x, y, n);
      if (t.face < 0) continue;
      const std::size_t i = std::size_t(y + d) * std::size_t(row) + std::size_t(x + d);
      directions[i] = unit_direction(t, n);
      solid[i] = angles[std::size_t(t.y) * std::size_t(n) + std::size_t(t.x)];
    }
  std::vector<double> values;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const std::size_t centre = std::size_t(y + d) * std::size_t(row) + std::size_t(x + d);
      const double e = sharpened(exponent, solid[centre], solid[centre]);
      const double nearest = std::cos(std::min(3.3 * 2 / std::sqrt(e), 1.5));
      begin_.push_back(std::int32_t(runs_.size()));
      weight_begin_.push_back(std::int32_t(weights_.size()));
      values.clear();
      double sum = 0;
      for (int j = std::max(y - d, -d); j < std::min(y + d + 1, n + d); ++j) {
        bool open = false;
        for (int i = std::max(x - d, -d); i < std::min(x + d + 1, n + d); ++i) {
          const std::size_t k = std::size_t(j + d) * std::size_t(row) + std::size_t(i + d);
          const double cosine = solid[k] > 0 ? glm::dot(directions[k], directions[centre]) : -1;
          if (cosine < nearest) {
            open = false;
            continue;
          }
          if (!open) runs_.push_back({std::int32_t(k), 0});
          open = true;
          ++runs_.back().count;
          values.push_back(lobe(cosine, e) * solid[k]);
          sum += values.back();
        }
      }
      for (const double v : values) weights_.push_back(float(v / sum));
    }
  begin_.push_back(std::int32_t(runs_.size()));
  weight_begin_.push_back(std::int32_t(weights_.size()));
}

CubeLevel LobeFilter::operator()(const PaddedFaces& source) const {
  CubeLevel out(size_);
  parallel_for(size_, 4, [&](int first, int last) {
    std::vector<float> sums(std::size_t(size_) * PaddedFaces::kBlock);
    for (int y = first; y < last; ++y) {
      sum_runs(source.blocks(), &runs_[0].first, begin_.data(), weight_begin_.data(),
               weights_.data(), y * size_, (y + 1) * size_, sums.data());
      for (int f = 0; f < 6; ++f) {
        glm::vec3* to = &out.texel(f, 0, y);
        const float* from = &sums[std::size_t(3 * f)];
        for (int x = 0; x < size_; ++x, from += PaddedFaces::kBlock)
          to[x] = {from[0], from[1], from[2]};
      }
    }
  });
  out.update_border();
  return out;
}

WideLobeFilter::WideLobeFilter(int source_size, int size, float exponent)
    : source_size_(source_size), size_(size) {
  const int sources = 6 * source_size * source_size, targets = 6 * size * size;
  const std::vector<double> from = texel_solid_angles(source_size), to = texel_solid_angles(size);
  weights_.resize(std::size_t(sources) * std::size_t(targets));
  std::vector<double> values(static_cast<std::size_t>(sources));
  const auto texel = [](int i, int n) { return Texel{i / (n * n), i % n, i / n % n}; };
  for (int t = 0; t < targets; ++t) {
    const glm::dvec3 axis = unit_direction(texel(t, size), size);
    double sum = 0;
    for (int s = 0; s < sources; ++s) {
      const double solid = from[std::size_t(s % (source_size * source_size))];
      const double e = sharpened(exponent, solid, to[std::size_t(t % (size * size))]);
      values[std::size_t(s)] =
          solid * lobe(glm::dot(axis, unit_direction(texel(s, source_size), source_size)), e);
      sum += values[std::size_t(s)];
    }
    for (int s = 0; s < sources; ++s)
      weights_[std::size_t(s) * std::size_t(targets) + std::size_t(t)] =
          float(values[std::size_t(s)] / sum);
  }
}

CubeLevel WideLobeFilter::operator()(const CubeLevel& source) const {
  const int sources = 6 * source_size_ * source_size_, targets = 6 * size_ * size_;
  std::vector<float> in;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < source_size_; ++y)
      for (int x = 0; x < source_size_; ++x) {
        const glm::vec3& t = source.texel(f, x, y);
        in.insert(in.end(), {t.x, t.y, t.z});
      }
  std::vector<float> part(std::size_t(3 * targets)), sums(part.size(), 0.0f);
  sum_all(weights_.data(), in.data(), sources, targets, part.data(), sums.data());
  CubeLevel out(size_);
  for (int f = 0, i = 0; f < 6; ++f)
    for (int y = 0; y < size_; ++y)
      for (int x = 0; x < size_; ++x, ++i) {
        const std::size_t k = std::size_t(i), n = std::size_t(targets);
        out.texel(f, x, y) = {sums[k], sums[n + k], sums[2 * n + k]};
      }
  out.update_border();
  return out;
}

}  // namespace fastibl
