// Tests the parts of the core that the Python side cannot reach.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "fastibl/capture/flicker_watch.h"
#include "fastibl/capture/light_tracks.h"
#include "fastibl/core/clock.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/parse_number.h"
#include "fastibl/core/plane_motion.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/solve.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/response.h"
#include "fastibl/scene/wide_lens.h"

using namespace fastibl;

TEST_CASE("a rotation vector is the inverse of its rotation up to half a turn") {
  for (const double short_of : {3.0, 1.0, 0.1, 1e-3, 1e-6, 1e-9, 0.0})
    for (const glm::dvec3 towards : {glm::dvec3(1, 0, 0), glm::dvec3(0, -1, 0), glm::dvec3(1, 2, 3),
                                     glm::dvec3(-1e-9, 1, -1)}) {
      CAPTURE(short_of);
      const glm::dvec3 w = (std::numbers::pi - short_of) * glm::normalize(towards);
      const glm::dmat3 rotation = rotation_from_vector(w);
      CHECK(rotation_angle(rotation_from_vector(rotation_vector(rotation)), rotation) < 1e-9);
      if (short_of > 1e-9) CHECK(glm::length(rotation_vector(rotation) - w) < 1e-6);
    }
}

TEST_CASE("small systems are solved, and those that are not positive definite refused") {
  constexpr std::size_t n = 4;
  // Hilbert's matrix: a condition number of 15514.
  std::array<double, n * n> a{}, inverse{};
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k) a[n * i + k] = 1 / double(i + k + 1);
  REQUIRE(invert<n>(a, inverse, 2));
  const std::array<double, n> first{16, -120, 240, -140};  // row of its inverse: whole numbers
  for (std::size_t k = 0; k < n; ++k) {
    CHECK(inverse[k] == doctest::Approx(2 * first[k]).epsilon(1e-10));
    CHECK(inverse[n * k] == doctest::Approx(2 * first[k]).epsilon(1e-10));
  }
  std::array<double, n> x{};
  REQUIRE(solve_symmetric<n>(a, {1, 0, 0, 0}, x));
  for (std::size_t k = 0; k < n; ++k) CHECK(x[k] == doctest::Approx(first[k]).epsilon(1e-10));
  std::array<double, n * 2> columns{0, 1, 0, 0, 0, 0, 0, 0};
  REQUIRE(solve_columns<n, 2>(a, columns, columns));
  for (std::size_t k = 0; k < n; ++k) {
    CHECK(columns[2 * k] == 0);
    CHECK(columns[2 * k + 1] == doctest::Approx(first[k]).epsilon(1e-10));
  }
  for (std::size_t k = 0; k < n; ++k) a[n * 3 + k] = a[n * k + 3] = a[n * 2 + k];  // singular
  a[15] = a[11];
  CHECK_FALSE(solve_symmetric<n>(a, first, x));
  a.fill(0);
  CHECK_FALSE(solve_symmetric<n>(a, first, x));
  a.fill(std::numeric_limits<double>::quiet_NaN());
  CHECK_FALSE(solve_symmetric<n>(a, first, x));
}

TEST_CASE("what is lifted is told by the object's middle, wherever the origin is") {
  const glm::vec2 middle(3, 1);
  const float size = 0.2f;
  for (const double turn : {0.0, 0.7, 3.0})
    for (const glm::dvec3 tilt : {glm::dvec3(0), glm::dvec3(5e-4, 0, 0), glm::dvec3(0, -5e-4, 0)}) {
      CAPTURE(turn);
      Pose pose{rotation_from_vector(tilt) * rotation_from_vector({0, 0, turn}), {1, 2, 0}};
      const double lift = (pose.rotation * glm::dvec3(middle, 0)).z;
      pose.translation.z = -lift;  // the middle lies on the plane
      const auto motion = motion_along_plane(pose, middle, size);
      REQUIRE(motion.has_value());
      CHECK(motion->turned() == (turn != 0));
      const glm::dvec2 there(pose * glm::dvec3(middle, 0));
      CHECK(glm::length(glm::dvec2(*motion * middle) - there) < 1e-5);
      CHECK(glm::length(motion->inverse() * (*motion * middle) - middle) < 1e-5f);
      pose.translation.z = -lift + 2e-3 * double(size);
      CHECK_FALSE(motion_along_plane(pose, middle, size).has_value());
    }
  CHECK_FALSE(motion_along_plane({rotation_from_vector({2e-3, 0, 0}), {0, 0, 0}}, {0, 0}, size));
  CHECK_FALSE(motion_along_plane({rotation_from_vector({3.14159265, 0, 0}), {}}, {0, 0}, size));
}

TEST_CASE("numbers are read alike with and without std::from_chars for doubles") {
  const double infinity = std::numeric_limits<double>::infinity();
  const std::pair<const char*, std::optional<double>> cases[] = {
      {"1", 1.0},
      {"-12.5e3", -12500.0},
      {".5", 0.5},
      {"5.", 5.0},
      {"1e+5", 1e5},
      {"4.9e-324", 4.9e-324},
      {"1e-310", 1e-310},
      {"1e-400", 0.0},
      {"1e400", infinity},
      {"-1e400", -infinity},
      {"0.1", 0.1},
      {"1.7976931348623157e308", 1.7976931348623157e308},
      {"", {}},
      {"-", {}},
      {"e5", {}},
      {"1e", {}},
      {"1e+", {}},
      {"--1", {}},
      {"1-", {}},
      {"+1", {}},
      {" 1", {}},
      {"1 ", {}},
      {"1,5", {}},
      {"0x10", {}},
      {"inf", infinity},
      {"-INF", -infinity},
      {"Infinity", infinity},
      {"+inf", {}},
      {"infinite", {}},
      {"nano", {}},
      {".", {}},
      {"1.2.3", {}}};
  for (const auto& [text, value] : cases) {
    CAPTURE(text);
    CHECK(parse_number(text) == value);
    CHECK(parse_number_by_stream(text) == value);
  }
  for (const char* text : {"nan", "NaN", "-nan"}) {
    CAPTURE(text);
    CHECK(std::isnan(parse_number(text).value_or(0)));
    CHECK(std::isnan(parse_number_by_stream(text).value_or(0)));
  }
}

TEST_CASE("decoding what is no number gives 0") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(Response::srgb().decode(nan) == 0);
  CHECK(Response::gamma(2.2).decode(nan) == 0);
}

TEST_CASE("a 360° camera sees all directions") {
  const Camera camera = Camera::equirectangular(400, 200);
  const WideLens lens(camera);
  const auto middle = lens.project({0, 0, 2}), right = lens.project({3, 0, 0}),
             up = lens.project({0, -1, 1e-9});
  REQUIRE((middle && right && up));
  CHECK(glm::length(*middle - glm::dvec2(200, 100)) < 1e-9);
  CHECK(glm::length(*right - glm::dvec2(300, 100)) < 1e-9);
  CHECK(up->y < 1e-6);
  CHECK_THROWS_AS(Camera::equirectangular(0, 200), std::invalid_argument);
}

TEST_CASE("light that is followed does not jump where the method of its irradiance changes") {
  constexpr int n = 32;
  float lamp = 60;
  const auto map = [&](float grey) {  // with a lamp, which nine coefficients get wrong
    std::vector<glm::vec3> texels(6 * n * n, glm::vec3(grey));
    for (int k = 0; k < 4; ++k) texels[std::size_t(n / 2 * n + n / 2 + k)] = glm::vec3(lamp);
    return std::make_shared<const CubeMap>(n, texels);
  };
  const std::vector<glm::vec3> normals = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-0.6f, 0, 0.8f}};
  const auto light_at = [&](const Lighting& lighting) {
    std::vector<glm::vec3> light(normals.size());
    evaluate(lighting.irradiance, normals, light);
    return light;
  };
  LightingOptions options;
  options.follows = true, options.chain = false;
  const auto by = [&](DiffuseMethod method, int size) {
    options.diffuse = method, options.diffuse_settings.size = size;
  };
  by(DiffuseMethod::sh9, 16);
  Lighting last = fit_lighting(map(0.5f), options);
  const std::vector<glm::vec3> sh9 = light_at(last);
  float jump = 0, whole = 0;
  const auto follow = [&](int maps) {
    for (int k = 0; k < maps; ++k) {
      const std::vector<glm::vec3> before = light_at(last);
      last = fit_lighting(map(0.5f + 1e-7f * float(k % 2 + 1)), options, &last);
      const std::vector<glm::vec3> now = light_at(last);
      for (std::size_t i = 0; i < now.size(); ++i)
        jump = std::max(jump, std::abs(now[i].x - before[i].x) / before[i].x);
    }
  };
  by(DiffuseMethod::irradiance_cube, 16);
  const std::vector<glm::vec3> cube = light_at(fit_lighting(map(0.5f), options));
  for (std::size_t i = 0; i < cube.size(); ++i)
    whole = std::max(whole, std::abs(cube[i].x - sh9[i].x) / cube[i].x);
  CHECK(whole > 0.03f);
  follow(20);
  CHECK(last.irradiance.fading);
  by(DiffuseMethod::irradiance_cube, 8);  // while the change still fades
  follow(20);
  by(DiffuseMethod::sh9, 16);
  follow(20);
  MESSAGE("the methods differ by ", whole, ", the largest step is ", jump);
  CHECK(jump < 0.15f * whole);
  by(DiffuseMethod::irradiance_cube, 16);
  follow(2000);
  CHECK(!last.irradiance.fading);
  for (std::size_t i = 0; i < cube.size(); ++i)
    CHECK(std::abs(light_at(last)[i].x / cube[i].x - 1) < 1e-4f);
  // Under another light the old method may be far off: only little of it stays.
  lamp = 300;
  by(DiffuseMethod::sh9, 16);
  const std::vector<glm::vec3> off = light_at(fit_lighting(map(0.5f), options));
  last = fit_lighting(map(0.4f), options);
  by(DiffuseMethod::irradiance_cube, 16);
  last = fit_lighting(map(0.5f), options, &last);
  const std::vector<glm::vec3> now = light_at(last);
  const std::vector<glm::vec3> right = light_at(fit_lighting(map(0.5f), options));
  float most = 0, of_old = 0;
  for (std::size_t i = 0; i < now.size(); ++i) {
    most = std::max(most, std::abs(now[i].x / right[i].x - 1));
    of_old = std::max(of_old, std::abs(off[i].x / right[i].x - 1));
  }
  MESSAGE("the old method is wrong by ", of_old, ", the fade by ", most);
  CHECK(of_old > 0.1f);
  CHECK(most < 0.5f * of_old);
}

TEST_CASE("one thread works on loops while it is asked to") {
  using Loops = OneThread::Loops;
  set_threads(2);
  // Whether another thread joins within a tenth of a second.
  const auto joined = [] {
    std::atomic<bool> others = false;
    const std::thread::id here = std::this_thread::get_id();
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(100);
    parallel_for(8, 1, [&](int, int) {
      if (std::this_thread::get_id() != here) others = true;
      while (std::this_thread::get_id() == here && !others &&
             std::chrono::steady_clock::now() < end) {
      }
    });
    return others.load();
  };
  CHECK(joined());
  {
    const OneThread alone(Loops::alone);
    CHECK(!joined());
    {
      const OneThread together(Loops::together);
      CHECK(joined());
    }
    CHECK(!joined());
  }
  CHECK(joined());
  set_threads(0);
}

namespace {

// Runs before main(), and before or after the library's own global objects: that order is not
// defined.
const float lit_before_main = [] {
  const auto map = std::make_shared<const CubeMap>(
      32, std::vector<glm::vec3>(std::size_t{6} * 32 * 32, glm::vec3(1)));
  const Lighting lighting = fit_lighting(map);
  std::vector<glm::vec3> normals(16, glm::vec3(0, 0, 1)), out(16);
  evaluate(lighting.irradiance, normals, out);
  return out[15].x;
}();

}  // namespace

TEST_CASE("global objects can use the library") {
  CHECK(lit_before_main == doctest::Approx(3.1416));
}

TEST_CASE("the number of threads can be asked for within a loop") {
  set_threads(2);
  std::atomic<int> asked{0};
  parallel_for(8, 1, [&](int, int) { asked += threads(); });
  CHECK(asked == 16);
  set_threads(0);
}

TEST_CASE("loops of more indices than two of their blocks can count") {
  for (const int grain : {1 << 30, std::numeric_limits<int>::max()}) {
    std::atomic<std::int64_t> seen = 0;
    parallel_for(std::numeric_limits<int>::max(), grain,
                 [&](int begin, int end) { seen += std::int64_t{end} - begin; });
    CHECK(seen == std::numeric_limits<int>::max());
  }
}

TEST_CASE("flicker is told by pictures of three seconds") {
  // Six pictures of a lamp that swings by a tenth, and another one.
  const auto seen = [](double apart) {
    FlickerWatch watch;
    FlickerWatch::Levelled levelled;
    bool any = false;
    for (int k = 0; k < 7; ++k)
      any |= watch.watch(1, k % 2 ? 0.1 : -0.1, 0.001, k * apart, levelled);
    return any;
  };
  CHECK(seen(0.1));
  CHECK(seen(0.7));
  CHECK_FALSE(seen(0.8));  // four of them are no swing
}

TEST_CASE("a light is located however many others came and went before") {
  const glm::dvec3 lamp(0.5, 0.3, 1.2);
  LightTracks tracks({0, 0, 0.05});
  const auto unseen = [](const glm::dvec3&) { return false; };  // as at the border of the picture
  for (int k = 0; k < 500; ++k) {
    const double turn = 2.4 * k, z = 0.1 + 0.5 * k / 500;
    const double across = std::sqrt(1 - z * z);
    const BrightSpot flash{{across * std::cos(turn), across * std::sin(turn), z}, 1e-3};
    tracks.add({0, 0, 0.3}, std::span(&flash, 1), unseen);
  }
  for (int k = 0; k < 16; ++k) {
    const glm::dvec3 eye(0.2 * std::cos(0.4 * k), 0.2 * std::sin(0.4 * k), 0.3);
    const BrightSpot spot{glm::normalize(lamp - eye), 1e-3};
    tracks.add(eye, std::span(&spot, 1), unseen);
  }
  const std::vector<LightPosition> lights = tracks.positions();
  REQUIRE(lights.size() == 1);
  CHECK(glm::length(lights[0].position - lamp) < 0.02);
}

TEST_CASE("a light that is seen from the same places again is known no better") {
  const glm::dvec3 lamp(0.5, 0.3, 1.2);
  const auto spread = [&](int rounds) {
    LightTracks tracks({0, 0, 0.05});
    for (int k = 0; k < 10 * rounds; ++k) {
      const glm::dvec3 eye(0.2 * std::cos(0.6 * (k % 10)), 0.2 * std::sin(0.6 * (k % 10)), 0.3);
      const BrightSpot spot{glm::normalize(lamp - eye), 1e-3};
      tracks.add(eye, std::span(&spot, 1), [](const glm::dvec3&) { return true; });
    }
    const std::vector<LightPosition> lights = tracks.positions();
    REQUIRE(lights.size() == 1);
    const glm::dmat3& m = lights[0].covariance;
    return std::sqrt(m[0][0] + m[1][1] + m[2][2]);
  };
  const double once = spread(1), often = spread(40);
  MESSAGE("metres after one round, and after 40: ", once, ", ", often);
  CHECK(often > 0.95 * once);
}

TEST_CASE("an update of tiles gives these a new version, and others none") {
  CubeMap map(64);
  const std::vector<std::uint64_t> before(map.tile_versions().begin(), map.tile_versions().end());
  const std::array changed = {3, 7};
  map.update(changed);
  for (int tile = 0; tile < map.tiles().count(); ++tile) {
    CAPTURE(tile);
    CHECK((map.tile_version(tile) != before[std::size_t(tile)]) == (tile == 3 || tile == 7));
  }
}

#ifdef CLOCK_THREAD_CPUTIME_ID
TEST_CASE("a thread's own time is not that of others") {
  const ProcessorClock own(ProcessorClock::Of::thread), all;
  std::thread([&] {
    while (all.seconds() < 0.05) {
    }
  }).join();
  CHECK(all.seconds() >= 0.05);
  CHECK(own.seconds() < 0.025);
}
#endif
