// What a Session gives after a change while it runs is what a new Session gives.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <cmath>
#include <stdexcept>

#include "fastibl/render/make_scene.h"
#include "fastibl/render/session.h"

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
