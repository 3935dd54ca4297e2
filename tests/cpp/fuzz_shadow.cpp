// Hostile spheres, grids and light, to be run with -fsanitize=address,undefined; see
// tests/test_fuzz_shadow.py. Arguments: number of cases (a million by default), seed.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>

#include "fastibl/shadow/direction_shadow.h"
#include "fastibl/shadow/ratio_at.h"

namespace {

using namespace fastibl;

class Fuzz {
 public:
  explicit Fuzz(std::uint64_t seed) : random_(seed) {}

  int below(int n) { return int(random_() % std::uint64_t(n)); }
  float near() { return std::uniform_real_distribution<float>(-2, 2)(random_); }
  // Any float: usual ones, edges of the range, and any bits.
  float any() {
    constexpr float kEdges[] = {0.0f,
                                -0.0f,
                                1.0f,
                                0.5f,
                                1e-45f,
                                1e-38f,
                                1e-6f,
                                1e4f,
                                1e6f,
                                -1e6f,
                                1e30f,
                                -1e30f,
                                3.4e38f,
                                -3.4e38f,
                                std::numeric_limits<float>::infinity(),
                                -std::numeric_limits<float>::infinity(),
                                std::numeric_limits<float>::quiet_NaN()};
    switch (below(4)) {
      case 0:
        return kEdges[below(int(std::size(kEdges)))];
      case 1:
        return std::ldexp(near(), below(250) - 125);
      default:
        return near();
    }
  }
  glm::vec4 sphere() {
    const glm::vec4 s(any(), any(), any(), any());
    switch (below(4)) {
      case 0:
        return {s.x, s.y, s.w, s.w};  // tangent
      case 1:
        return {s.x, s.y, 0.2f - s.w, s.w};  // a crest of 0.2
      case 2:
        return {near(), near(), near(), std::fabs(near())};
      default:
        return s;
    }
  }
  SphereSet spheres(int most) {
    SphereSet set;
    for (int n = below(most + 1); n > 0; --n) set.push_back(sphere());
    return set;
  }
  glm::vec3 upwards() {
    const float z = below(3) ? std::fabs(near()) + 1e-3f : 1e-3f;
    return glm::normalize(glm::vec3(below(4) ? near() : 0, below(4) ? near() : 0, z));
  }
  CubeMap map() {
    const int n = 1 << below(4);
    std::vector<glm::vec3> faces(std::size_t(6 * n * n), glm::vec3(below(2) ? 0.1f : 0));
    for (int i = below(8); i > 0; --i)
      faces[std::size_t(below(int(faces.size())))] = {any(), any(), any()};
    return CubeMap(n, faces);
  }

 private:
  std::mt19937_64 random_;
};

bool fair(float ratio) { return ratio >= 0 && ratio <= 1; }  // false for NaN

void require(bool holds, const char* what, long i) {
  if (holds) return;
  std::printf("case %ld: %s\n", i, what);
  std::exit(1);
}

// Bits, on any grid; and, one case in 64, a whole cast with what points say.
void run(Fuzz& fuzz, long i, DirectionShadow& caster) {
  const SphereSet spheres = fuzz.spheres(3);
  const float extent = std::fabs(fuzz.any());
  PlaneGrid grid{1 + fuzz.below(70),
                 {fuzz.near(), fuzz.near()},
                 std::isfinite(extent) && extent > 0 ? extent : 1};
  if (fuzz.below(8) == 0) grid.centre = {1e30f, -1e30f};
  PlaneBits bits(grid.size);
  const PlaneSpheres on_plane(spheres, grid);
  require(on_plane.size() + on_plane.ignored() <= int(spheres.size()), "counts", i);
  on_plane.add_shadow(fuzz.upwards(), bits);
  for (int c = 0; c < bits.columns(); ++c)
    for (int y = 0; y < bits.padded_rows(); ++y) {
      const int left = y < grid.size ? grid.size - 64 * c : 0;
      const std::uint64_t outside = left >= 64 ? 0 : ~std::uint64_t{0} << left;
      require((std::as_const(bits).column(c)[y] & outside) == 0, "bit outside the grid", i);
    }
  if (i % 64 != 0) return;
  const CubeMap cube = fuzz.map();
  ShadowOptions options;
  options.resolution = 2 + fuzz.below(40);
  options.outer = fuzz.below(2);
  if (fuzz.below(2)) options.extent = 2;
  const ShadowMap& map = caster.cast(cube, spheres, options);
  for (const float r : map.ratio.data) require(fair(r), "ratio of the map", i);
  for (const float r : map.outer.data) require(fair(r), "ratio of the outer map", i);
  require(std::isfinite(map.extent) && std::isfinite(map.outer_extent), "extent", i);
  glm::vec2 points[70];
  glm::vec3 ratios[70];
  for (glm::vec2& p : points) p = {fuzz.any(), fuzz.any()};
  map.sample(points, ratios);
  for (const glm::vec3& r : ratios) require(fair(r.x) && fair(r.y) && fair(r.z), "sample", i);
  for (const glm::vec3& r : ratio_at(points, spheres, light_directions(cube, 8)))
    require(fair(r.x) && fair(r.y) && fair(r.z), "ratio at a point", i);
}

}  // namespace

int main(int count, char** arguments) {
  const long cases = count > 1 ? std::atol(arguments[1]) : 1000000;
  Fuzz fuzz(count > 2 ? std::uint64_t(std::atoll(arguments[2])) : 1);
  DirectionShadow caster(16);
  for (long i = 0; i < cases; ++i) run(fuzz, i, caster);
  std::printf("%ld cases\n", cases);
}
