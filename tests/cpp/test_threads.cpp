// Two sessions in two threads, which share the pool of threads: the same bits as alone. Under the
// thread sanitizer (./dev sanitize thread) it looks for races in all that a session runs.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <random>
#include <thread>

#include "fastibl/core/parallel.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/session.h"

using namespace fastibl;

namespace {

Mesh pyramid() {
  Mesh mesh;
  mesh.vertices = {
      {-.05f, -.05f, 0}, {.05f, -.05f, 0}, {.05f, .05f, 0}, {-.05f, .05f, 0}, {0, 0, .1f}};
  mesh.triangles = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};
  return mesh;
}

// Pictures of both cameras, of noise, from given poses; all methods chosen by the plan.
std::vector<std::uint8_t> run_session(unsigned seed) {
  Rig rig;
  rig.back.width = 64, rig.back.height = 48;
  rig.back.fx = rig.back.fy = 50;
  rig.back.cx = 32, rig.back.cy = 24;
  rig.front = rig.back;
  rig.front_from_back.rotation = glm::dmat3({-1, 0, 0}, {0, 1, 0}, {0, 0, -1});
  Material material;
  material.glossy = glm::vec3(0.3f);
  SceneOptions scene;
  scene.sphere_count = 10;
  scene.bake_shadow = true;
  SessionOptions options;
  options.map_size = 32;
  Session session(make_scene(pyramid(), material, {}, scene), rig, std::nullopt, nullptr, nullptr,
                  make_cpu_renderer(), options);
  std::mt19937 random(seed);
  std::vector<std::uint8_t> bits;
  for (int k = 0; k < 3; ++k) {
    Image<std::uint8_t> back(64, 48, 3), front(64, 48, 3);
    for (Image<std::uint8_t>* image : {&back, &front})
      for (std::uint8_t& value : image->data) value = std::uint8_t(random() % 256);
    Frame frame;
    frame.time = k / 30.0;
    frame.back = {back.data.data(), PixelType::uint8, 64, 48, 192};
    frame.front = {front.data.data(), PixelType::uint8, 64, 48, 192};
    // Straight down from 30 cm.
    frame.back_from_marker = Pose{glm::dmat3({1, 0, 0}, {0, -1, 0}, {0, 0, -1}), {0.01 * k, 0, .3}};
    const Image<std::uint8_t> image = session.process(frame).image;
    bits.insert(bits.end(), image.data.begin(), image.data.end());
  }
  return bits;
}

}  // namespace

TEST_CASE("two sessions in two threads give what they give alone") {
  set_threads(3);
  const std::vector<std::uint8_t> alone[] = {run_session(0), run_session(1)};
  CHECK(alone[0] != alone[1]);
  std::vector<std::uint8_t> together[2];
  std::thread other([&] { together[1] = run_session(1); });
  together[0] = run_session(0);
  other.join();
  CHECK(together[0] == alone[0]);
  CHECK(together[1] == alone[1]);
}
