// Reads a fuzzer's bytes as the values that callers hand in: usual values, the edges of their
// range, and any bits. After the end of the bytes, all further ones are 0.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>

#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"

namespace fastibl {

class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : at_(data), end_(data + size) {}

  bool empty() const { return at_ == end_; }
  std::uint8_t byte() { return at_ == end_ ? std::uint8_t(0) : *at_++; }
  bool chance(int of) { return below(of) == 1; }  // one in `of`; never after the end of the bytes
  int below(int n) {                              // up to 65536
    if (n <= 1) return 0;
    int value = byte();
    if (n > 256) value = value << 8 | byte();
    return value % n;
  }
  int between(int least, int most) { return least + below(most - least + 1); }
  // 0 to 1, both included.
  float share() { return float(below(65536)) / 65535.0f; }
  float within(float least, float most) { return least + (most - least) * share(); }
  // −2 to 2.
  float near() { return within(-2, 2); }
  // Any float: in half of the cases a usual one, else an edge of the range or any bits.
  float any() {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    constexpr float kEdges[] = {0.0f,
                                -0.0f,
                                1.0f,
                                0.5f,
                                -1.0f,
                                1e-45f,
                                1e-38f,
                                1e-6f,
                                1e4f,
                                1e6f,
                                -1e6f,
                                1e9f,
                                1e30f,
                                -1e30f,
                                3.4e38f,
                                -3.4e38f,
                                1e-3f,
                                65504.f,
                                65520.f,
                                1e-20f,
                                kInfinity,
                                -kInfinity,
                                std::numeric_limits<float>::quiet_NaN()};
    switch (below(8)) {
      case 1:
      case 2:
        return kEdges[below(int(std::size(kEdges)))];
      case 3:
        return std::bit_cast<float>(word());
      case 4:
        return std::ldexp(near(), below(250) - 125);
      default:
        return near();
    }
  }
  double any_double() {
    return chance(16) ? std::bit_cast<double>(std::uint64_t(word()) << 32 | word()) : double(any());
  }
  glm::vec3 any3() {
    const float x = any(), y = any();
    return {x, y, any()};
  }
  glm::vec3 near3() {
    const float x = near(), y = near();
    return {x, y, near()};
  }
  glm::vec3 unit() {
    const glm::vec3 d = near3();
    const float length = glm::length(d);
    return length > 1e-3f ? d / length : glm::vec3(0, 0, 1);
  }
  // A rigid pose at any place: the Python border and Pose::from_matrix refuse all that are not
  // rigid.
  Pose pose() {
    Pose pose;
    pose.rotation = rotation_from_vector(3.0 * glm::dvec3(near3()));
    for (int i = 0; i < 3; ++i) {
      const float x = chance(16) ? any() : near();
      pose.translation[i] = std::isfinite(x) ? double(x) : 0.0;
    }
    return pose;
  }

 private:
  std::uint32_t word() {
    std::uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | byte();
    return value;
  }
  const std::uint8_t* at_;
  const std::uint8_t* end_;
};

// Ends the run as a finding if something that must hold does not.
void require(bool holds, const char* what);

inline bool finite(const glm::vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
inline bool finite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
inline bool is_light(const glm::vec3& v) { return finite(v) && v.x >= 0 && v.y >= 0 && v.z >= 0; }
inline bool is_ratio(float r) { return r >= 0 && r <= 1; }  // false for NaN
inline bool is_ratio(const glm::vec3& r) { return is_ratio(r.x) && is_ratio(r.y) && is_ratio(r.z); }

// The target itself. It may throw std::invalid_argument: a clear refusal.
void fuzz(Input& input);

}  // namespace fastibl
