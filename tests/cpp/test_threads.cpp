// Two sessions in two threads share the pool of threads: they give the same bits as alone. Under
// the thread sanitizer (./dev sanitize thread) this looks for races in all that a session runs.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <thread>

#include "fastibl/core/parallel.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/session.h"
#include "fastibl/shadow/direction_shadow.h"

using namespace fastibl;

namespace {

Mesh pyramid() {
  Mesh mesh;
  mesh.vertices = {
      {-.05f, -.05f, 0}, {.05f, -.05f, 0}, {.05f, .05f, 0}, {-.05f, .05f, 0}, {0, 0, .1f}};
  mesh.triangles = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};
  return mesh;
}

// Pictures of both cameras, made of noise, with given poses; the plan chooses all methods.
using Shown = std::function<void(const FrameResult&)>;
std::vector<std::uint8_t> run_session(unsigned seed, int frames = 3, const Shown& shown = {}) {
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
  for (int k = 0; k < frames; ++k) {
    Image<std::uint8_t> back(64, 48, 3), front(64, 48, 3);
    for (Image<std::uint8_t>* image : {&back, &front})
      for (std::uint8_t& value : image->data) value = std::uint8_t(random() % 256);
    Frame frame;
    frame.time = k / 30.0;
    frame.back = {back.data.data(), PixelType::uint8, 64, 48, 192};
    frame.front = {front.data.data(), PixelType::uint8, 64, 48, 192};
    // The camera looks straight down from 30 cm.
    frame.back_from_marker = Pose{glm::dmat3({1, 0, 0}, {0, -1, 0}, {0, 0, -1}), {0.01 * k, 0, .3}};
    const FrameResult result = session.process(frame);
    if (shown) shown(result);
    const Image<std::uint8_t>& image = result.image;
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

namespace {

// The newest of the values that one thread makes; another thread reads it and lets it go.
template <typename T>
class Newest {
 public:
  void put(std::shared_ptr<const T> value) { swap(value); }
  std::shared_ptr<const T> take() {
    std::shared_ptr<const T> value;
    swap(value);
    return value;
  }

 private:
  void swap(std::shared_ptr<const T>& value) {
    const std::lock_guard lock(mutex_);
    value_.swap(value);
  }
  std::mutex mutex_;
  std::shared_ptr<const T> value_;
};

// Whether each value that the other thread gets, until `make` has ended, stays as it is while it is
// held.
template <typename T>
bool stays(const std::function<void(Newest<T>&)>& make,
           const std::function<double(const T&)>& read) {
  Newest<T> newest;
  std::atomic<bool> made = false;
  bool same = true;
  std::thread reader([&] {
    while (!made) {
      const std::shared_ptr<const T> value = newest.take();
      const double before = value ? read(*value) : 0;
      std::this_thread::yield();
      same &= !value || read(*value) == before;
    }
  });
  make(newest);
  made = true;
  reader.join();
  return same;
}

}  // namespace

// Maps and shadows are written anew once nobody holds them any more.
TEST_CASE("maps and shadows that another thread reads and lets go") {
  set_threads(3);
  CHECK(stays<Environment>(
      [](Newest<Environment>& newest) {
        run_session(2, 12, [&](const FrameResult& result) { newest.put(result.environment); });
      },
      [](const Environment& environment) {
        double sum = 0;
        for (int f = 0; f < 6; ++f) sum += double(environment.radiance.level(0).texel(f, 16, 16).x);
        return sum;
      }));
  CHECK(stays<ShadowMap>(
      [](Newest<ShadowMap>& newest) {
        const CubeMap sky(32, std::vector<glm::vec3>(std::size_t{6} * 32 * 32, glm::vec3(1)));
        DirectionShadow shadow;
        for (int k = 0; k < 30; ++k)
          newest.put(shadow.cast(sky, {{0.002f * float(k), 0, 0.05f, 0.04f}}));
      },
      [](const ShadowMap& map) { return double(map.ratio.data[map.ratio.data.size() / 2]); }));
}
