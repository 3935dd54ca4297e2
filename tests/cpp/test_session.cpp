// What a Session gives after a change while it runs is what a new Session gives.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>

#include "fastibl/core/clock.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/method_judge.h"
#include "fastibl/render/rig_tracker.h"
#include "fastibl/render/session.h"
#include "fastibl/shading/in_view.h"
#include "fastibl/shadow/scene_shadow.h"

using namespace fastibl;

namespace {

Mesh pyramid(float height) {
  Mesh mesh;
  mesh.vertices = {{-0.03f, -0.03f, 0},
                   {0.03f, -0.03f, 0},
                   {0.03f, 0.03f, 0},
                   {-0.03f, 0.03f, 0},
                   {0, 0, height}};
  mesh.triangles = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}, {0, 2, 1}, {0, 3, 2}};
  return mesh;
}

Scene scene(float height) {
  SceneOptions options;
  options.bake_shadow = true;
  Material material;
  material.glossy = glm::vec3(0.2f);
  return make_scene(pyramid(height), material, Pose(), options);
}

// Light that is brighter from one side.
std::shared_ptr<const Environment> light() {
  std::vector<glm::vec3> faces;
  for (int f = 0; f < 6; ++f) faces.insert(faces.end(), 16 * 16, glm::vec3(f == 0 ? 4.0f : 0.5f));
  return std::make_shared<const Environment>(environment_from(CubeMap(16, faces)));
}

// A sun in one texel, so high at a distance of 1.
CubeMap sun_at(double height) {
  CubeMap map(32, std::vector<glm::vec3>(6 * 32 * 32, glm::vec3(0.01f)));
  const glm::vec3 towards = glm::normalize(glm::vec3(1, 0.3f, float(height)));
  glm::vec3* brightest = nullptr;
  float most = -1;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 32; ++x) {
        const glm::vec3 d = face_direction(f, (float(x) + 0.5f) / 32, (float(y) + 0.5f) / 32);
        const float c = glm::dot(glm::normalize(d), towards);
        if (c > most) most = c, brightest = &map.base().texel(f, x, y);
      }
  *brightest = glm::vec3(5000);
  map.update();
  return map;
}

struct Camera160 {
  Rig rig;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(160 * 120 * 3, 120);
  Frame frame;
  Camera160() {
    rig.back.width = 160, rig.back.height = 120;
    rig.back.fx = rig.back.fy = 200, rig.back.cx = 80, rig.back.cy = 60;
    frame.back = {pixels.data(), PixelType::uint8, 160, 120, 160 * 3};
    // Seen from above, a little to one side: y down is −z of the marker's plane turned by 45
    // degrees.
    const double s = std::sqrt(0.5);
    Pose pose;
    pose.rotation = glm::transpose(glm::dmat3({1, 0, 0}, {0, -s, -s}, {0, s, -s}));
    pose.translation = -(pose.rotation * glm::dvec3(0, -0.25, 0.27));
    frame.back_from_marker = pose;
  }
  Session session(float height, const SessionOptions& options = {}) const {
    return {scene(height), rig, std::nullopt, light(), nullptr, make_cpu_renderer(), options};
  }
};

}  // namespace

TEST_CASE("another object gives what a session that began with it gives") {
  const Camera160 camera;
  Session changed = camera.session(0.05f), fresh = camera.session(0.12f);
  const Image<std::uint8_t> before = changed.process(camera.frame).image;
  changed.set_scene(scene(0.12f));
  const Image<std::uint8_t> after = changed.process(camera.frame).image;
  CHECK(after == fresh.process(camera.frame).image);
  CHECK(after != before);
}

TEST_CASE("a map that its owner has written to is read anew when it is given again") {
  const Camera160 camera;
  const auto own = std::make_shared<Environment>(*light());
  const auto session_under = [&](std::shared_ptr<const Environment> map) {
    return Session(scene(0.05f), camera.rig, std::nullopt, map, nullptr, make_cpu_renderer());
  };
  Session session = session_under(own);
  const Image<std::uint8_t> before = session.process(camera.frame).image;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) own->radiance.base().texel(2, x, y) = glm::vec3(9, 1, 1);
  own->radiance.update();
  session.set_environment(own);
  const Image<std::uint8_t> after = session.process(camera.frame).image;
  CHECK(after != before);
  CHECK(after ==
        session_under(std::make_shared<const Environment>(*own)).process(camera.frame).image);
}

TEST_CASE("another object may not have a broken shadow look") {
  Session session = Camera160().session(0.05f);
  Scene broken = scene(0.05f);
  broken.shadow_look.strength = -1;
  CHECK_THROWS_AS(session.set_scene(broken), std::invalid_argument);
}

TEST_CASE("budgets set later give what a session that began with them gives") {
  const Camera160 camera;
  SessionOptions coarse;
  coarse.error = 0.2;
  Session changed = camera.session(0.1f), fresh = camera.session(0.1f, coarse);
  changed.process(camera.frame);
  changed.set_budgets(0.2, 0);
  const Image<std::uint8_t> after = changed.process(camera.frame).image;
  CHECK(after == fresh.process(camera.frame).image);
  CHECK(changed.plan().error_budget == 0.2);
  CHECK(changed.plan().methods == fresh.plan().methods);
  CHECK_THROWS_AS(changed.set_budgets(-1, 0), std::invalid_argument);
  CHECK_THROWS_AS(changed.set_budgets(0.1, std::nan("")), std::invalid_argument);
}

TEST_CASE("a result that is used again is a new one, in the same memory") {
  const Camera160 camera;
  Session again = camera.session(0.1f), fresh = camera.session(0.1f);
  std::vector<float> linear(160 * 120 * 3, 0.3f);
  FrameResult result;
  const std::uint8_t* memory = nullptr;
  for (int k = 0; k < 6; ++k) {
    CAPTURE(k);
    Frame frame = camera.frame;
    frame.time = 0.1 * k;
    if (k == 2) frame.back_from_marker.reset();  // nothing is drawn
    if (k == 3) frame.back = {};                 // four channels
    if (k == 4) frame.back = {linear.data(), PixelType::float32, 160, 120, 160 * 3 * 4};
    again.process(frame, result);
    const FrameResult other = fresh.process(frame);
    CHECK(result.image == other.image);
    CHECK(result.passes == other.passes);
    CHECK(result.back_from_marker.has_value() == other.back_from_marker.has_value());
    if (k == 1 || k == 5) CHECK(result.image.data.data() == memory);
    memory = result.image.data.data();
  }
}

TEST_CASE("a session that reads nothing back leaves the picture with its renderer") {
  const Camera160 camera;
  SessionOptions options;
  options.read_back = false;
  Session session = camera.session(0.05f, options), reads = camera.session(0.05f);
  Frame lost = camera.frame;
  lost.back_from_marker.reset();
  FrameResult result;
  for (const Frame& frame : {camera.frame, lost, camera.frame}) {
    reads.process(frame, result);
    const Image<std::uint8_t> image = result.image;
    session.process(frame, result);
    CHECK(result.image.data.empty());
    CHECK(result.image.width == 0);
    CHECK(session.renderer().image() == image);
    CHECK((image.data == camera.pixels) == !frame.back_from_marker);
  }
}

TEST_CASE("the maps of a session are read where they are") {
  const Camera160 camera;
  Session session = camera.session(0.1f);
  session.process(camera.frame);
  const ShadowMap& shadow = session.shadow_map();
  CHECK(!shadow.ratio.empty());
  CHECK(&shadow == &session.shadow_map());
  CHECK(&session.plane_gain() == &session.plane_gain());
}

TEST_CASE("a frame that failed leaves nothing half done") {
  const Camera160 camera;
  Scene bare = scene(0.05f);
  bare.baked_shadow = nullptr;
  for (const double error : {0.02, 0.0}) {
    SessionOptions options;
    options.error = error, options.methods.shadow = ShadowMethod::directions;
    Session session{bare, camera.rig, std::nullopt, light(), nullptr, make_cpu_renderer(), options};
    const Image<std::uint8_t> before = session.process(camera.frame).image;
    Methods unbaked = options.methods;
    unbaked.shadow = ShadowMethod::mesh;
    session.set_methods(unbaked);
    for (int k = 0; k < 3; ++k)  // the same error each time
      CHECK_THROWS_WITH_AS(session.process(camera.frame), doctest::Contains("baked"),
                           std::invalid_argument);
    session.set_methods(options.methods);
    CHECK(session.process(camera.frame).image == before);
  }
}

TEST_CASE("no shadow goes beyond where it is looked for") {
  const Camera160 camera;
  const Pose upright, along{glm::dmat3(1), {0.2, 0.1, 0}}, lifted{glm::dmat3(1), {0, 0, 0.1}},
      tilted{rotation_from_vector({0.3, 0.4, 0}), {-0.1, 0, 0.02}},
      turned{rotation_from_vector({0, 0, 0.7}), {0, 0.3, 0}};
  const Scene standing = scene(0.05f);
  for (const double height : {0.02, 0.1, 0.5})  // of a sun, by its distance
    for (const ShadowMethod method : {ShadowMethod::mesh, ShadowMethod::directions,
                                      ShadowMethod::cap_sum, ShadowMethod::cap_product})
      for (const Pose& pose : {upright, along, lifted, tilted, turned}) {
        INFO(height, " ", std::string(name(method)), " ", pose.translation.x);
        SessionOptions options;
        options.error = 0, options.methods.shadow = method;
        Scene stands = standing;
        stands.marker_from_object = pose;
        Session session(stands, camera.rig, std::nullopt,
                        std::make_shared<const Environment>(environment_from(sun_at(height))),
                        nullptr, make_cpu_renderer(), options);
        session.process(camera.frame);
        const ShadowMap& map = session.shadow_map();
        REQUIRE(!map.ratio.empty());
        const PlaneSquare most = farthest_shadow(stands, method);
        for (int i = 0; i < 2; ++i) {
          CHECK(map.centre[i] - map.reach() >= most.centre[i] - most.extent * (1 + 1e-5f));
          CHECK(map.centre[i] + map.reach() <= most.centre[i] + most.extent * (1 + 1e-5f));
        }
        CHECK(most.extent < 15 * map.extent);  // not just the whole plane
      }
}

TEST_CASE("what a picture does not show is not made until it does") {
  const Camera160 camera;
  Frame away = camera.frame, back = camera.frame;
  away.back_from_marker->translation.z = -3;  // all is behind
  Session session = camera.session(0.1f), fresh = camera.session(0.1f);
  FrameResult result = session.process(away);
  CHECK(result.image.data == camera.pixels);
  CHECK(result.passes == std::vector<PassId>{PassId::irradiance});
  CHECK(result.lighting != nullptr);
  CHECK(session.object().rgba.empty());
  result = session.process(back);
  CHECK(result.image == fresh.process(back).image);
  CHECK(result.image.data != camera.pixels);
  // The light changes while nothing is seen of it.
  const auto other = std::make_shared<const Environment>(
      environment_from(CubeMap(16, std::vector<glm::vec3>(6 * 16 * 16, glm::vec3(2)))));
  session.set_environment(other), fresh.set_environment(other);
  result = session.process(away);
  CHECK(result.image.data == camera.pixels);
  CHECK(result.lighting->plane_irradiance.x == doctest::Approx(2 * 3.14159265).epsilon(1e-3));
  CHECK(session.process(back).image == fresh.process(back).image);
}

TEST_CASE("a view shows what is in its picture, and not much more") {
  Camera wide;
  wide.width = 160, wide.height = 120, wide.fx = wide.fy = 90, wide.cx = 80, wide.cy = 60;
  Camera bent = wide;
  bent.distortion = {-0.25, 0.06, 0.002, -0.001};
  std::uint32_t state = 1;
  const auto random = [&] { return double(state = state * 1664525u + 1013904223u) / 4294967296.0; };
  const auto spread = [&](double s) {
    const double x = random(), y = random(), z = random();
    return s * (2.0 * glm::dvec3(x, y, z) - 1.0);
  };
  for (const Camera& camera : {wide, bent}) {
    const PictureView view(camera);
    const Lens lens(camera);
    int shown = 0, hidden = 0, needless = 0;
    for (int trial = 0; trial < 2000; ++trial) {
      const glm::dvec3 axis = glm::normalize(spread(1) + glm::dvec3(0, 0, 1e-9));
      const Pose pose{rotation_from_vector(6.3 * random() * axis), spread(1)};
      const glm::dvec3 a = spread(0.6), b = a + 0.3 * (spread(1) + 1.0);
      const Bounds box{glm::vec3(a), glm::vec3(b)};
      const float extent = float(0.01 + 0.5 * random());
      // Points of both, and by how much they miss the picture at least.
      double box_misses = 1e9, square_misses = 1e9;
      const auto misses = [&](const glm::dvec3& point) {
        const auto pixel = lens.project(pose * point);
        if (!pixel) return 1e9;
        return std::max({-pixel->x, -pixel->y, pixel->x - 160, pixel->y - 120, 0.0});
      };
      constexpr int kSteps = 10;
      for (int i = 0; i <= kSteps; ++i)
        for (int j = 0; j <= kSteps; ++j) {
          const glm::dvec2 t = glm::dvec2(i, j) / double(kSteps);
          square_misses =
              std::min(square_misses, misses(glm::dvec3(double(extent) * (2.0 * t - 1.0), 0)));
          for (int k = 0; k <= kSteps; ++k)
            box_misses =
                std::min(box_misses, misses(glm::mix(glm::dvec3(box.lower), glm::dvec3(box.upper),
                                                     glm::dvec3(t, double(k) / kSteps))));
        }
      const bool box_shown = view.may_show(box, pose),
                 square_shown = view.may_show(glm::vec2(0), extent, pose);
      if (box_misses == 0) CHECK(box_shown);
      if (square_misses == 0) CHECK(square_shown);
      for (const auto& [may, off] :
           {std::pair(box_shown, box_misses), {square_shown, square_misses}}) {
        shown += may, hidden += !may;
        needless += may && off > 60;
      }
    }
    MESSAGE(shown, " shown, ", hidden, " not, ", needless, " needlessly");
    CHECK(shown > 500);
    CHECK(hidden > 1000);
    CHECK(needless < 0.03 * hidden);
  }
}

TEST_CASE("methods are judged anew soon where a place is discovered, and seldom where it goes on") {
  const Scene given = scene(0.08f);
  // The share of the light that comes from one side.
  const auto map = [](float share) {
    std::vector<glm::vec3> faces;
    for (int f = 0; f < 6; ++f)
      faces.insert(faces.end(), 16 * 16, glm::vec3(f == 0 ? share : (1 - share) / 5));
    return std::make_shared<const Environment>(environment_from(CubeMap(16, faces)));
  };
  const auto light = [&](float share) { return summary_of(map(share)->radiance); };
  MethodJudge judge;
  const auto judge_under = [&](float share) {
    const Methods asked;
    judge.begin(given, LightToJudge::of(map(share)), light(share), asked, candidates(asked, {}),
                true);
    CHECK(!judge.due());
    CHECK(judge.step(true));
  };
  // Frames until another judgement is due; -1 if none is.
  const auto frames_under = [&](float share, int most) {
    for (int k = 1; k <= most; ++k) {
      judge.add_frame();
      judge.follow(light(share));
      if (judge.due()) return k;
    }
    return -1;
  };
  CHECK(judge.due());
  CHECK(judge.unjudged(light(0.5f)) == 0);  // nothing is measured yet
  judge_under(0.2f);
  CHECK(frames_under(0.24f, 100) == -1);
  CHECK(judge.unjudged(light(0.24f)) == 0);
  CHECK(frames_under(0.5f, 1) == 1);
  const double part = judge.unjudged(light(0.5f));
  CHECK(part == doctest::Approx(0.6 / 1.3));
  // What is being measured is not known yet.
  judge.begin(given, LightToJudge::of(map(0.5f)), light(0.5f), {}, candidates({}, {}), true);
  CHECK(!judge.step(false));
  CHECK(judge.unjudged(light(0.5f)) == part);
  while (!judge.step(false)) continue;
  CHECK(judge.unjudged(light(0.5f)) == 0);
  bool other = true;
  for (const int wait : {8, 16, 32, 64, 64}) {
    CHECK(frames_under(other ? 0.2f : 0.5f, 100) == wait);
    judge_under(other ? 0.2f : 0.5f);
    other = !other;
  }
  CHECK(frames_under(other ? 0.5f : 0.2f, 200) == -1);  // it stays
  CHECK(frames_under(other ? 0.2f : 0.5f, 1) == 1);
  judge_under(other ? 0.2f : 0.5f);
  CHECK(frames_under(other ? 0.5f : 0.2f, 100) == 4);
}

TEST_CASE("pictures of one time leave nothing behind") {
  // Those of given light may all have the same time. Seconds that the first one takes in which the
  // board is lost, after so many in which it was seen.
  const auto seconds = [](int seen) {
    Rig rig;
    rig.back.width = 64, rig.back.height = 48;
    rig.back.fx = rig.back.fy = 50, rig.back.cx = 32, rig.back.cy = 24;
    const auto blind = [](ImageView<const std::uint8_t>, const Board&, const Camera&) {
      return Detection{};
    };
    RigTracker tracker(rig, Board::default_board(), blind, true);
    const auto light = std::make_shared<const Environment>(
        environment_from(CubeMap(8, std::vector<glm::vec3>(6 * 64, glm::vec3(1)))));
    const Image<std::uint8_t> picture(64, 48, 3, 100);
    Frame frame;
    frame.back = {picture.data.data(), PixelType::uint8, 64, 48, 192};
    const auto follow = [&](bool found) {
      SeenAround around;
      around.map = [&] { return light; };
      around.mapped = true, around.look = tracker.look_due(frame.time);
      around.pictures.back = frame.back;
      FrameResult result;
      if (found) {
        result.tracked = Tracked{};
        result.tracked->camera_from_marker = Pose::look_at({0, -0.3, 0.2}, {0, 0, 0});
        result.back_from_marker = result.tracked->camera_from_marker;
      }
      const Stopwatch watch;
      tracker.follow(frame, std::move(around), result);
      return watch.seconds();
    };
    for (int k = 0; k < seen; ++k) follow(true);
    return follow(false);
  };
  double few = 1, many = 1;
  for (int k = 0; k < 3; ++k)
    few = std::min(few, seconds(10)), many = std::min(many, seconds(300'000));
  MESSAGE("ms after few, and after many: ", 1e3 * few, ", ", 1e3 * many);
  CHECK(many < 10 * few);
}
