// What a C++ caller can get wrong, where for Python the bindings check first: it gives an error
// that names the fault, or a defined result.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "fastibl/capture/capture.h"
#include "fastibl/capture/next_view.h"
#include "fastibl/lighting/fit_glossy_chain.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/session.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/equirect.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/tag_codes.h"
#include "fastibl/scene/texture.h"
#include "fastibl/shading/composite.h"
#include "fastibl/shadow/direction_shadow.h"
#include "fastibl/shadow/mesh_shadow_light.h"
#include "fastibl/shadow/sphere_shadow.h"
#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/rotation_tracker.h"

using namespace fastibl;

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

std::shared_ptr<const CubeMap> grey(int size = 16) {
  return std::make_shared<const CubeMap>(
      size, std::vector<glm::vec3>(std::size_t(6 * size * size), glm::vec3(1)));
}

bool finite(glm::vec3 v) { return std::isfinite(v.x + v.y + v.z); }

Scene tetrahedron() {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.1f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  return make_scene(mesh, Material());
}

// A camera above the plane.
struct View {
  Rig rig;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(64 * 48 * 3, 100);
  Frame frame;
  View() {
    rig.back = Camera::from_opencv(64, 48, 80, 80, 31.5, 23.5);
    frame.back = {pixels.data(), PixelType::uint8, 64, 48};
    frame.back_from_marker = Pose::look_at({0.2, -0.3, 0.3}, {0, 0, 0});
  }
  Session session(Scene scene, std::shared_ptr<const Environment> environment,
                  SessionOptions options = {}) const {
    return {std::move(scene),    rig,    std::nullopt, std::move(environment), nullptr,
            make_cpu_renderer(), options};
  }
};

}  // namespace

TEST_CASE("settings that a method does not have") {
  const auto fitted = [](LightingOptions options) { return fit_lighting(grey(), options); };
  for (const int taps : {1, 5, 1000, -2}) {
    CAPTURE(taps);
    LightingOptions options;
    options.glossy = GlossyMethod::stretched, options.glossy_settings.taps = taps;
    CHECK_THROWS_WITH_AS(fitted(options), doctest::Contains("taps"), std::invalid_argument);
  }
  LightingOptions own;
  own.glossy = GlossyMethod::stretched;  // 0 taps: the method's own number
  CHECK(finite(evaluate_glossy(fitted(own), {0, 0, 1}, {0, 0, 1}, 64)));
  LightingOptions lights;
  lights.glossy_settings.lights = 9;
  CHECK_THROWS_AS(fitted(lights), std::invalid_argument);
  for (const int size : {0, -1, 257}) {
    CAPTURE(size);
    LightingOptions cube;
    cube.diffuse = DiffuseMethod::irradiance_cube, cube.diffuse_settings.size = size;
    CHECK_THROWS_WITH_AS(fitted(cube), doctest::Contains("size"), std::invalid_argument);
    cube.diffuse_settings = {}, cube.diffuse_settings.source = size;
    CHECK_THROWS_WITH_AS(fitted(cube), doctest::Contains("source"), std::invalid_argument);
  }
  LightingOptions followed;  // it becomes irradiance-cube
  followed.follows = true, followed.diffuse_settings.size = 0;
  CHECK_THROWS_WITH_AS(fitted(followed), doctest::Contains("size"), std::invalid_argument);
  SessionOptions few;
  few.methods.shadow_settings.directions = 1;
  CHECK_THROWS_WITH_AS(View().session(tetrahedron(), nullptr, few), doctest::Contains("directions"),
                       std::invalid_argument);
  SessionOptions options;
  options.methods.glossy = GlossyMethod::sampled, options.methods.glossy_settings.taps = 100000000;
  CHECK_THROWS_AS(View().session(tetrahedron(), nullptr, options), std::invalid_argument);
  Session session = View().session(tetrahedron(), nullptr);
  CHECK_THROWS_AS(session.set_methods(options.methods), std::invalid_argument);
}

TEST_CASE("sessions of what is empty") {
  const auto empty = std::make_shared<const Environment>();
  CHECK_THROWS_AS(View().session(tetrahedron(), empty), std::invalid_argument);
  CHECK_THROWS_AS(View().session(Scene{}, nullptr), std::invalid_argument);
  Session session = View().session(tetrahedron(), nullptr);
  CHECK_THROWS_AS(session.set_environment(empty), std::invalid_argument);
  CHECK_THROWS_AS(session.set_scene(Scene{}), std::invalid_argument);
}

TEST_CASE("poses that are none") {
  const View view;
  Session session =
      view.session(tetrahedron(), std::make_shared<const Environment>(environment_from(*grey())));
  Pose nowhere;
  nowhere.translation.x = std::nan("");
  Pose twice;
  twice.rotation *= 2.0;
  for (const Pose& pose : {nowhere, twice}) {
    Frame frame = view.frame;
    frame.back_from_marker = pose;
    CHECK_THROWS_WITH_AS(session.process(frame), doctest::Contains("pose"), std::invalid_argument);
    CHECK_THROWS_AS(session.move(pose), std::invalid_argument);
    CHECK_THROWS_AS(make_scene(tetrahedron().mesh, Material(), pose), std::invalid_argument);
  }
  CHECK(session.process(view.frame).image.width == 64);
}

TEST_CASE("exponents, normals and views that are none") {
  LightingOptions options;
  for (const GlossyMethod method : kGlossyMethods) {
    CAPTURE(name(method));
    options.glossy = method;
    const Lighting lighting = fit_lighting(grey(), options);
    for (const float exponent : {kNaN, -1.0f, -1e9f})
      CHECK_THROWS_AS(GlossyShading(lighting, exponent), std::invalid_argument);
    // For a vector that is no direction there is no light, but an answer.
    for (const float exponent : {0.0f, 1.0f, 64.0f, std::numeric_limits<float>::infinity()}) {
      evaluate_glossy(lighting, glm::vec3(kNaN), {0, 0, 1}, exponent);
      evaluate_glossy(lighting, {0, 0, 1}, glm::vec3(kNaN), exponent);
    }
    const GgxShading ggx(lighting);
    const SurfaceFrame frame{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (const float alpha : {0.0f, -1.0f, 2.0f, kNaN})
      CHECK(glm::length(ggx(frame, {0, 0, 1}, glm::vec2(alpha)).mean() - 1.0f) < 1e-3f);
    ggx(frame, glm::vec3(kNaN), glm::vec2(0.3f));
  }
  const Lighting none;
  CHECK_THROWS_AS(evaluate_glossy(none, {0, 0, 1}, {0, 0, 1}, 8), std::invalid_argument);
  const GgxShading dark(none);
  CHECK_THROWS_AS(dark({{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {0, 0, 1}, glm::vec2(0.3f)),
                  std::invalid_argument);
}

TEST_CASE("maps and meshes that are empty or broken") {
  const CubeMap none;
  CHECK_THROWS_AS(CubeMap().base(), std::invalid_argument);
  CHECK_THROWS_AS(none.sample({0, 0, 1}, 0), std::invalid_argument);
  CHECK_THROWS_AS(none.mean(), std::invalid_argument);
  CHECK_THROWS_AS(none.level_at_most(8), std::invalid_argument);
  CHECK_THROWS_AS(equirect_from_cubemap(none, 16), std::invalid_argument);
  Irradiance cube;
  cube.method = DiffuseMethod::irradiance_cube;
  CHECK_THROWS_AS(evaluate(cube, {0, 0, 1}), std::invalid_argument);

  Mesh mesh = tetrahedron().mesh;
  CHECK_THROWS_AS(vertex_tangents(mesh, {}), std::invalid_argument);
  mesh.triangles[0].x = 1000;
  CHECK_THROWS_AS(is_closed(mesh), std::invalid_argument);
  CHECK_THROWS_AS(faces_outwards(mesh), std::invalid_argument);
  CHECK_THROWS_AS(vertex_normals(mesh), std::invalid_argument);
  CHECK_THROWS_AS(Bvh{mesh}, std::invalid_argument);
  CHECK_THROWS_AS(bounds({}), std::invalid_argument);

  for (const ShadowMethod method : {ShadowMethod::directions, ShadowMethod::cap_product})
    for (const float irradiance : {kNaN, -5.0f}) {
      ShadowOptions options;
      options.method = method;
      CHECK_THROWS_AS(cast_shadow(*grey(), glm::vec3(irradiance), {{0, 0, 0.1f, 0.05f}}, options),
                      std::invalid_argument);
    }
}

TEST_CASE("pictures whose size is none, or not that of their values") {
  CHECK_THROWS_WITH_AS(Image<float>(-1, 5, 3), doctest::Contains("-1 × 5"), std::invalid_argument);
  CHECK_THROWS_AS(Image<std::uint8_t>(-1, -1, 3), std::invalid_argument);
  CHECK(Image<float>(0, 5, 3).empty());
  Image<float> image;
  image.width = image.height = 10, image.data.resize(5);
  CHECK_THROWS_WITH_AS(SurfaceTexture{image}, doctest::Contains("needs 300 values, got 5"),
                       std::invalid_argument);
  image.width = -10;
  CHECK_THROWS_AS(SurfaceTexture{image}, std::invalid_argument);
  image.width = 10, image.data.resize(300);
  CHECK(SurfaceTexture(image).level_count() > 1);
}

TEST_CASE("rows without a distance are packed") {
  std::vector<float> half(16 * 8 * 3);  // its lower half is white
  std::fill(half.begin() + 16 * 4 * 3, half.end(), 1.0f);
  const CubeMap map = cubemap_from_equirect({half.data(), 16, 8}, 8);
  CHECK(map.mean().x == doctest::Approx(0.5).epsilon(1e-4));
  CHECK_THROWS_AS(cubemap_from_equirect({half.data(), 16, 8, 3, 16}, 8), std::invalid_argument);

  View view;
  std::fill(view.pixels.end() - 64 * 3, view.pixels.end(), std::uint8_t{50});
  Session session = view.session(tetrahedron(), nullptr);
  CHECK(*session.process(view.frame).image.pixel(10, 47) == 50);
  view.frame.back.row_bytes = 64;
  CHECK_THROWS_AS(session.process(view.frame), std::invalid_argument);
}

TEST_CASE("pictures and masks whose rows or pixels lie where they cannot be read") {
  const View view;
  const Camera& camera = view.rig.back;
  const Pose pose = *view.frame.back_from_marker;
  const Detector blind = [](const auto&, const auto&, const auto&) { return Detection{}; };
  std::vector<float> room(64 * 48 * 3 + 64, 0.5f);
  char* const begin = reinterpret_cast<char*>(room.data());
  constexpr std::ptrdiff_t kRow = 64 * 3;
  const auto refused = [&](const Picture& picture, const char* message) {
    CAPTURE(message);
    const auto names = doctest::Contains(message);
    CHECK_THROWS_WITH_AS(check_picture(picture), names, std::invalid_argument);
    CHECK_THROWS_WITH_AS(linear_from(picture, {}), names, std::invalid_argument);
    CHECK_THROWS_WITH_AS(grey_from(picture, {}), names, std::invalid_argument);
    CHECK_THROWS_WITH_AS(bytes_from(picture, {}), names, std::invalid_argument);
    CHECK_THROWS_WITH_AS(scale_below_white(picture), names, std::invalid_argument);
    CHECK_THROWS_WITH_AS(Capture().add(picture, camera, pose, 1.0, 0), names,
                         std::invalid_argument);
    EdgeTracker tracker(Board::default_board(), camera);
    CHECK_THROWS_WITH_AS(tracker.track(picture, 0.0, blind), names, std::invalid_argument);
    RigPictures pictures;
    pictures.back = picture;
    CHECK_THROWS_WITH_AS(RotationTracker(view.rig).start(pose, 0, pictures), names,
                         std::invalid_argument);
    Session session = view.session(tetrahedron(), nullptr);
    Frame frame = view.frame;
    frame.back = picture;
    CHECK_THROWS_AS(session.process(frame), std::invalid_argument);
  };
  refused({begin, PixelType::uint8, 64, 48, 64}, "at least 192 bytes apart, got 64");
  refused({begin, PixelType::uint8, 64, 48, -64}, "at least 192 bytes apart, got -64");
  refused({begin, PixelType(9), 64, 48}, "got type 9");
  refused({begin + 1, PixelType::uint16, 64, 48}, "multiples of 2 bytes");
  refused({begin, PixelType::uint16, 64, 48, 2 * kRow + 1}, "multiples of 2 bytes");
  refused({begin + 2, PixelType::float32, 64, 48}, "multiples of 4 bytes");
  refused({begin, PixelType::float32, 64, 48, 4 * kRow + 2}, "multiples of 4 bytes");
  // From the lowest row upwards, and bytes at any address.
  CHECK_NOTHROW(check_picture({begin + 47 * kRow + 1, PixelType::uint8, 64, 48, -kRow}));
  CHECK_NOTHROW(check_picture({begin + 2, PixelType::uint16, 64, 48, 2 * kRow + 2}));

  const std::vector<std::uint8_t> bytes(64 * 48, 255);
  const ImageView<const std::uint8_t> narrow{bytes.data(), 64, 48, 1, 10};
  CHECK_THROWS_WITH_AS(Capture().add(view.frame.back, camera, pose, 1.0, 0, narrow),
                       doctest::Contains("rows of the mask"), std::invalid_argument);
  CHECK_THROWS_WITH_AS(track(blind, narrow, Board::default_board(), camera),
                       doctest::Contains("rows of a grey picture"), std::invalid_argument);
}

TEST_CASE("what is no light is cleaned, and counted, however it came") {
  std::vector<float> picture(16 * 8 * 3, 1.0f);
  picture[0] = kNaN, picture[50] = -2, picture[99] = std::numeric_limits<float>::infinity();
  const CleaningStatistics found = cubemap_from_equirect({picture.data(), 16, 8}, 8).cleaned();
  CHECK(found == CleaningStatistics{1, 1, 1});

  for (const float bad : {kNaN, std::numeric_limits<float>::infinity()}) {
    CubeMap whole(16), part(16);
    for (CubeMap* map : {&whole, &part})
      for (int f = 0; f < 6; ++f)
        for (int y = 0; y < 16; ++y)
          for (int x = 0; x < 16; ++x) map->base().texel(f, x, y) = glm::vec3(1);
    part.update();
    whole.base().texel(2, 3, 4).y = bad, part.base().texel(2, 3, 4).y = bad;
    whole.update();
    const int tile = tile_place(part.tiles(), 2, 3, 4).tile;
    part.update({&tile, 1});
    for (const CubeMap& map : {whole, part}) {
      CHECK(map.cleaned().total() == 1);
      CHECK(map.level(0).texel(2, 3, 4).y == (std::isnan(bad) ? 0 : kRadianceCap));
      const Lighting lighting = fit_lighting(std::make_shared<const CubeMap>(map));
      CHECK(finite(evaluate(lighting.irradiance, {0, 0, 1})));
    }
  }
}

TEST_CASE("pictures, masks and poses that a capture cannot use") {
  const View view;
  Capture capture;
  const Pose pose = *view.frame.back_from_marker;
  std::vector<std::uint8_t> bytes(64 * 48);
  const ImageView<const std::uint8_t> of_three{bytes.data(), 64, 48};
  const ImageView<const std::uint8_t> of_one{bytes.data(), 64, 48, 1};
  const Picture nothing{nullptr, PixelType::uint8, 64, 48};
  CHECK_THROWS_WITH_AS(capture.add(view.frame.back, view.rig.back, pose, 1.0, 0, of_three),
                       doctest::Contains("one channel"), std::invalid_argument);
  CHECK_THROWS_WITH_AS(capture.add(nothing, view.rig.back, pose, 1.0, 0),
                       doctest::Contains("no pixels"), std::invalid_argument);
  CHECK_THROWS_AS(linear_from(nothing, Response::srgb()), std::invalid_argument);
  Pose twice = pose;
  twice.rotation *= 2.0;
  CHECK_THROWS_WITH_AS(capture.add(view.frame.back, view.rig.back, twice, 1.0, 0),
                       doctest::Contains("pose"), std::invalid_argument);
  CHECK_THROWS_AS(capture.turn(glm::dmat3(std::nan(""))), std::invalid_argument);
  capture.add(view.frame.back, view.rig.back, pose, 1.0, 0, of_one);
  EdgeTracker tracker(Board::default_board(), view.rig.back);
  CHECK_THROWS_WITH_AS(tracker.track(view.frame.back, 0.0, nullptr), doctest::Contains("detector"),
                       std::invalid_argument);
}

TEST_CASE("a captured environment whose map was replaced by one of another size") {
  const View view;
  for (const int size : {8, 16, 32}) {
    CaptureOptions options;
    options.size = size;
    Capture capture(options);
    capture.add(view.frame.back, view.rig.back, *view.frame.back_from_marker, 1.0, 0);
    Environment environment = *capture.environment();
    CHECK_NOTHROW(environment.validate());
    CHECK(environment.confidence().size() == std::size_t(6 * size * size));
    for (const int other : {4, 64, 256}) {
      CAPTURE(other);
      environment.radiance = *grey(other);
      CHECK_THROWS_WITH_AS(environment.validate(), doctest::Contains("another map"),
                           std::invalid_argument);
      CHECK_THROWS_AS(environment.confidence(), std::invalid_argument);
      CHECK_THROWS_AS(environment.age(), std::invalid_argument);
      CHECK_THROWS_AS(next_view(environment), std::invalid_argument);
    }
    environment = *capture.environment();
    environment.variance.pop_back();
    CHECK_THROWS_WITH_AS(environment.confidence(), doctest::Contains("variances"),
                         std::invalid_argument);
    environment.radiance = {};
    CHECK_THROWS_AS(environment.confidence(), std::invalid_argument);
  }
}

TEST_CASE("cameras whose response is none") {
  for (const std::vector<float>& curve :
       {std::vector<float>{1}, {1, 0.5f}, {0, kNaN, 1}, {0, 0.5f, 0.5f, 1}}) {
    View view;
    view.rig.back.response.curve = curve;
    CHECK_THROWS_WITH_AS(view.session(tetrahedron(), nullptr), doctest::Contains("response"),
                         std::invalid_argument);
  }
}

TEST_CASE("scenes and rigs that were made by hand") {
  Scene scene = tetrahedron();
  scene.material.pbr = std::make_shared<PbrMaterial>();
  CHECK_THROWS_AS(View().session(scene, nullptr), std::invalid_argument);
  scene = tetrahedron();
  scene.visibility.clear();
  CHECK_THROWS_WITH_AS(View().session(scene, nullptr), doctest::Contains("visibility"),
                       std::invalid_argument);
  View view;
  view.rig.front = view.rig.back;
  view.rig.front_from_back.rotation *= -1.0;
  CHECK_THROWS_AS(view.session(tetrahedron(), nullptr), std::invalid_argument);
  SessionOptions options;
  options.front_ratio.x = std::nan("");
  CHECK_THROWS_WITH_AS(View().session(tetrahedron(), nullptr, options),
                       doctest::Contains("front_ratio"), std::invalid_argument);
}

TEST_CASE("what has no map, and results without room") {
  Lighting none;
  CHECK_THROWS_AS(fit_chain(none), std::invalid_argument);
  CHECK_THROWS_AS(working_level(CubeMap()), std::invalid_argument);
  CHECK_THROWS_AS(tag_module_black(0, 6, 0), std::invalid_argument);
  const std::vector<glm::vec2> points(5);
  std::vector<glm::vec3> few(4);
  CHECK_THROWS_AS(ShadowMap().sample(points, few), std::invalid_argument);
}

TEST_CASE("nothing to shade needs no map") {
  for (const GlossyMethod method : {GlossyMethod::mip, GlossyMethod::centroid}) {
    Lighting none;
    none.glossy = method;
    GlossyShading(none, 8.0f)({}, {}, {}, {});
  }
}

TEST_CASE("options of trackers out of range") {
  const Rig rig = View().rig;
  const auto tracker = [&](auto change) {
    RotationTrackingOptions options;
    change(options);
    RotationTracker(rig, options);
  };
  CHECK_NOTHROW(tracker([](auto&) {}));
  CHECK_THROWS_AS(tracker([](auto& o) { o.wander = double(kNaN); }), std::invalid_argument);
  CHECK_THROWS_AS(tracker([](auto& o) { o.sure = 0; }), std::invalid_argument);
  CHECK_THROWS_AS(tracker([](auto& o) { o.least_agreeing = 2; }), std::invalid_argument);
  CHECK_THROWS_AS(tracker([](auto& o) { o.alignment.coarsest = 3; }), std::invalid_argument);
  CHECK_THROWS_AS(tracker([](auto& o) { o.alignment.rounds = 0; }), std::invalid_argument);
  EdgeTrackingOptions edges;
  edges.most_rounds = 0;
  CHECK_THROWS_AS(EdgeTracker(Board(), rig.back, edges), std::invalid_argument);
}

TEST_CASE("a map that is kept and written to lights what follows") {
  Material shiny;
  shiny.diffuse = glm::vec3(0), shiny.glossy = glm::vec3(0.5f);
  const auto kept = std::make_shared<Environment>(environment_from(*grey()));
  const View view;
  const auto session_of = [&](std::shared_ptr<const Environment> light) {
    return view.session(make_scene(tetrahedron().mesh, shiny), std::move(light));
  };
  const auto brightness = [](const Image<std::uint8_t>& image) {
    double sum = 0;
    for (const std::uint8_t v : image.data) sum += v;
    return sum;
  };
  Session session = session_of(kept);
  Frame frame = view.frame;
  for (int k = 0; k < 8; ++k) {
    std::vector<glm::vec3> texels(std::size_t{6} * 16 * 16, glm::vec3(1 - 0.1f * float(k)));
    kept->radiance = CubeMap(16, texels);
    session.set_environment(kept);
    frame.time = k;
    const double shown = brightness(session.process(frame).image);
    Session fresh = session_of(std::make_shared<const Environment>(*kept));
    CAPTURE(k);
    CHECK(shown == doctest::Approx(brightness(fresh.process(view.frame).image)).epsilon(0.01));
  }
}

TEST_CASE("a session that is moved goes on") {
  const View view;
  const auto light = std::make_shared<const Environment>(environment_from(*grey()));
  std::vector<Session> sessions;
  Session stays = view.session(tetrahedron(), light);
  sessions.push_back(view.session(tetrahedron(), light));
  Frame frame = view.frame;
  for (int k = 0; k < 6; ++k) {
    frame.time = k;
    Session moved = std::move(sessions.back());
    sessions.back() = std::move(moved);
    CHECK(sessions.back().process(frame).image == stays.process(frame).image);
  }
}

TEST_CASE("what was refused has changed nothing") {
  const auto object = [](float size) {
    Mesh mesh = tetrahedron().mesh;
    for (glm::vec3& v : mesh.vertices) v *= size;
    return std::make_shared<const ShadowTriangles>(mesh);
  };
  const auto first = object(1), second = object(3);
  DirectionShadow shadow(64);
  shadow.cast(*grey(), first, {});
  CHECK_THROWS_AS(shadow.cast(CubeMap(), second, {}), std::invalid_argument);
  CHECK(shadow.cast(*grey(), second, {})->ratio ==
        DirectionShadow(64).cast(*grey(), second, {})->ratio);

  const View view;
  const std::vector<std::uint8_t> small(16 * 16 * 3, 100);
  const Environment environment = environment_from(*grey());
  const Pose pose = Pose::look_at({0.3, -0.4, 0.3}, {0, 0, 0});
  const glm::dmat3 turn = rotation_from_vector({0, 0.17, 0});
  RigPictures pictures, other;
  pictures.back = view.frame.back, other.back = {small.data(), PixelType::uint8, 16, 16};
  const auto turned = [&](bool refused) {
    RotationTracker tracker(view.rig);
    tracker.start(pose, 0, pictures);
    if (refused) {
      CHECK_THROWS_WITH_AS(tracker.track(environment, other, 0.1, turn),
                           doctest::Contains("got 16 × 16"), std::invalid_argument);
      CHECK_THROWS_AS(tracker.start(Pose(), 0.1, other), std::invalid_argument);
    }
    return tracker.track(environment, pictures, 0.1, turn);
  };
  REQUIRE(turned(false).has_value());
  CHECK(*turned(true) == *turned(false));
}

TEST_CASE("a shadow's light that is asked for another object begins anew") {
  std::vector<glm::vec3> texels(std::size_t{6} * 16 * 16, glm::vec3(1));
  texels[100] = glm::vec3(1000);
  const CubeMap sun(16, texels);
  const auto bake = [](float size, int resolution) {
    Mesh mesh = tetrahedron().mesh;
    for (glm::vec3& v : mesh.vertices) v *= size;
    MeshShadowOptions options;
    options.resolution = resolution, options.rings = 4, options.extent = 0.5f;
    return *MeshShadow::bake(mesh, options);
  };
  MeshShadowLight light;
  for (const auto& [size, resolution] :
       {std::pair{1.0f, 64}, {3.0f, 64}, {1.0f, 16}, {2.0f, 128}}) {
    CAPTURE(size);
    CAPTURE(resolution);
    const MeshShadow shadow = bake(size, resolution);
    CHECK(light.cast(shadow, sun).ratio == MeshShadowLight().cast(shadow, sun).ratio);
  }
}

TEST_CASE("a composite of pictures and layers of other sizes") {
  const View view;
  const PixelTable table(view.rig.back);
  const std::vector<std::uint8_t> large(80 * 60 * 3, 100);
  const Picture other{large.data(), PixelType::uint8, 80, 60};
  const auto composed = [&](const Picture& picture, const ObjectLayer& object,
                            const ObjectLayer& holdout) {
    return composite(picture, 1, table, Pose(), object, ShadowLookUp(ShadowMap()), holdout);
  };
  CHECK_THROWS_WITH_AS(composed(other, {}, {}), doctest::Contains("64 × 48, got 80 × 60"),
                       std::invalid_argument);
  ObjectLayer layer;
  layer.rgba = Image<float>(10, 10, 4);
  CHECK(composed(view.frame.back, layer, layer).width == 64);
  for (const auto& [x, y] : {std::pair{-1, 0}, {0, 39}, {55, 0}, {1 << 30, 0}}) {
    layer.x = x, layer.y = y;
    CHECK_THROWS_WITH_AS(composed(view.frame.back, layer, {}), doctest::Contains("the object"),
                         std::invalid_argument);
    CHECK_THROWS_AS(composed(view.frame.back, {}, layer), std::invalid_argument);
  }
}

TEST_CASE("light of a map that was written to since") {
  const auto map = std::make_shared<CubeMap>(16);
  const auto fill = [&](float value) {
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < 16; ++y)
        for (int x = 0; x < 16; ++x) map->base().texel(f, x, y) = glm::vec3(value);
    map->update();
  };
  LightingOptions options;
  options.follows = true;
  const glm::vec3 n(0, 0, 1);
  fill(1);
  const Lighting before = fit_lighting(map, options);
  CHECK(fit_lighting(map, options, &before).chain == before.chain);
  fill(3);
  const Lighting after = fit_lighting(map, options, &before);
  CHECK(evaluate_glossy(after, n, n, 64).x == doctest::Approx(3).epsilon(1e-4));
  CHECK(evaluate(after.irradiance, n).x == doctest::Approx(3 * 3.14159265).epsilon(1e-4));
}

TEST_CASE("pictures that are stored from the lowest row up") {
  // Nothing may be read behind the highest row, which is the last one here.
  std::vector<float> pixels(16 * 8 * 3);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = float(i % 7);
  std::vector<float> upright;
  for (int y = 7; y >= 0; --y)
    upright.insert(upright.end(), pixels.begin() + y * 48, pixels.begin() + (y + 1) * 48);
  const ImageView<const float> flipped{pixels.data() + 7 * 48, 16, 8, 3, -48},
      same{upright.data(), 16, 8, 3};
  for (const EquirectFilter filter : {EquirectFilter::area, EquirectFilter::point})
    CHECK(cubemap_from_equirect(flipped, 8, filter) == cubemap_from_equirect(same, 8, filter));
}

TEST_CASE("boards and irradiance that are none") {
  CHECK_THROWS_WITH_AS(Board::grid(46341, 46341, 0.02, 0.005), doctest::Contains("at most 587"),
                       std::invalid_argument);
  CHECK(Board::grid(1, 587, 0.02, 0.005).tags.size() == 587);
  Irradiance none;
  none.method = DiffuseMethod::irradiance_cube;
  const std::vector<glm::vec3> normals(9, glm::vec3(0, 0, 1));
  std::vector<glm::vec3> out(9);
  CHECK_THROWS_AS(evaluate(none, normals, out), std::invalid_argument);
}
