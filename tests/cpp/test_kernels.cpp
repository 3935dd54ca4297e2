// Compares fast paths with the plain ones: many codes at once, small triangles, lights that are
// kept, pieces of a map.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>

#include "fastibl/core/lanes.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/response.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/interpolate.h"
#include "fastibl/shading/light_disc.h"
#include "fastibl/shading/light_pieces.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/sample_cells.h"
#include "fastibl/shadow/plane_bits.h"
#include "fastibl/tracking/find_tags.h"

using namespace fastibl;

TEST_CASE("rows of codes are decoded and encoded as single ones are") {
  std::vector<float> steep = {0.0f, 1e-6f, 2e-6f, 0.5f, 1.0f};
  std::mt19937 random(0);
  std::uniform_real_distribution<float> light(-0.1f, 1.2f);
  for (const Response& response :
       {Response::srgb(), Response::gamma(2.2), Response::gamma(0.3), Response::from_curve(steep),
        Response::srgb().between(16 / 255.0, 235 / 255.0),
        Response::srgb().between(7.5 / 255.0, 251.5 / 255.0)}) {
    const ByteResponse table(response);
    std::vector<float> linear(4001);
    for (float& v : linear) v = light(random);
    linear[0] = std::numeric_limits<float>::quiet_NaN();
    linear[1] = std::numeric_limits<float>::infinity(), linear[2] = -linear[1];
    linear[3] = 1, linear[4] = std::nextafter(1.0f, 0.0f), linear[5] = 1e-30f, linear[6] = 0;
    std::vector<std::uint8_t> codes(linear.size());
    table.encode(linear.data(), codes.data(), codes.size());
    std::vector<float> back(codes.size());
    table.decode(codes.data(), back.data(), back.size());
    int wrong = 0;
    for (std::size_t i = 0; i < codes.size(); ++i)
      wrong += codes[i] != table.encode(linear[i]) || back[i] != table.decode(codes[i]);
    CHECK(wrong == 0);
    // Also around the ends of every code.
    std::vector<float> ends;
    for (int k = 0; k < 255; ++k) {
      float low = table.decode(std::uint8_t(k)), high = table.decode(std::uint8_t(k + 1));
      while (std::nextafter(low, high) < high) {
        const float middle = low + 0.5f * (high - low);
        (table.encode(middle) > k ? high : low) = middle == low ? high : middle;
      }
      ends.push_back(low), ends.push_back(high);
    }
    codes.resize(ends.size());
    table.encode(ends.data(), codes.data(), codes.size());
    for (std::size_t i = 0; i < ends.size(); ++i) CHECK(codes[i] == table.encode(ends[i]));
    // Factors that change no code.
    CHECK(table.least_unseen() < 1);
    CHECK(table.most_unseen() > 1);
    for (int k = 0; k < 256; ++k) {
      const float value = table.decode(std::uint8_t(k));
      const int code = table.encode(value);  // k, clamped to the response's levels
      CHECK(code == std::clamp(k, int(table.encode(0)), int(table.encode(1))));
      CHECK(table.encode(value * table.least_unseen()) == code);
      CHECK(table.encode(value * table.most_unseen()) == code);
    }
  }
}

TEST_CASE("points of many directions are those of single ones") {
  std::mt19937 random(4);
  std::normal_distribution<float> any;
  std::vector<glm::vec3> directions = {{1, 0, 0},      {-1, 0, 0},       {0, 1, 0},
                                       {0, -1, 0},     {0, 0, 1},        {0, 0, -1},
                                       {1e-20f, 0, 1}, {0, -1e-20f, -1}, {-0.0f, 1, 0}};
  while (directions.size() < 2003)
    directions.push_back(glm::normalize(glm::vec3(any(random), any(random), any(random))));
  std::vector<float> x, y, z, u(directions.size()), v(directions.size());
  for (const glm::vec3& d : directions) x.push_back(d.x), y.push_back(d.y), z.push_back(d.z);
  octahedral_points(int(x.size()), x.data(), y.data(), z.data(), u.data(), v.data());
  float worst = 0;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const glm::vec2 p = octahedral_point(directions[i]);
    worst = std::max({worst, std::fabs(p.x - u[i]), std::fabs(p.y - v[i])});
  }
  CHECK(worst < 1e-6f);
}

TEST_CASE("glossy light of many places is that of single ones") {
  std::mt19937 random(6);
  std::normal_distribution<float> any;
  const auto unit = [&] {
    return glm::normalize(glm::vec3(any(random), any(random), any(random)));
  };
  constexpr int n = 32;
  std::vector<glm::vec3> faces(6 * n * n);
  for (glm::vec3& f : faces) f = glm::abs(unit());
  faces[4 * n * n + 7 * n + 20] = {4e4f, 3e4f, 2e4f};
  faces[2 * n * n + 25 * n + 3] = {1e2f, 3e3f, 2e2f};
  std::vector<glm::vec3> normals(205), views(205), positions(205);
  for (std::size_t i = 0; i < normals.size(); ++i)
    normals[i] = unit(), views[i] = unit(), positions[i] = 0.3f * unit();
  for (std::size_t i = 0; i < 40; ++i) views[i] = normals[i];  // along the normal
  for (std::size_t i = 40; i < 80; ++i)                        // from behind
    views[i] = glm::normalize(0.5f * unit() - normals[i]);
  for (std::size_t i = 80; i < 120; ++i)  // grazing
    views[i] = glm::normalize(glm::cross(normals[i], unit()));
  float worst = 0;
  for (const GlossyMethod method :
       {GlossyMethod::centroid, GlossyMethod::stretched, GlossyMethod::mip, GlossyMethod::sampled})
    for (const Normalization normalization : {Normalization::energy, Normalization::paper})
      for (const int near : {0, 1, 2}) {
        LightingOptions options;
        options.glossy = method, options.normalization = normalization;
        Lighting lighting = fit_lighting(std::make_shared<const CubeMap>(n, faces), options);
        if (near > 0) {
          REQUIRE((!lighting.chain || arrays_of(lighting).count > 1));
          lighting.near_lights.centre = {0.05f, -0.02f, 0.1f};
          lighting.light_distances.assign(kMaxLights, 0.8f);
        }
        if (near > 1) lighting.box = RoomBox{glm::dvec3(-2), glm::dvec3(3)};
        for (const float s : {0.0f, 0.5f, 3.0f, 6.0f, 8.0f, 64.0f, 2e3f, 1e6f, INFINITY}) {
          const GlossyShading shading(lighting, s);
          std::vector<glm::vec3> out(normals.size()), at_centre(normals.size());
          shading(normals, views, positions, out);
          shading(normals, views, {}, at_centre);
          for (std::size_t i = 0; i < out.size(); ++i) {
            const glm::vec3 placed = shading(normals[i], views[i], positions[i]),
                            central = shading(normals[i], views[i]);
            for (int c = 0; c < 3; ++c) {
              worst = std::max(worst, std::abs(out[i][c] - placed[c]) / (placed[c] + 1e-3f));
              worst =
                  std::max(worst, std::abs(at_centre[i][c] - central[c]) / (central[c] + 1e-3f));
            }
          }
        }
      }
  MESSAGE("off by ", worst);
  CHECK(worst < 2e-3f);  // on a map of noise, whose texels differ as much as they can

  // Vectors that are no directions may give any result, but read nothing beyond the map.
  const Lighting lighting = fit_lighting(std::make_shared<const CubeMap>(n, faces));
  const std::vector<glm::vec3> none = {glm::vec3(NAN), glm::vec3(0), glm::vec3(INFINITY, 0, 0)};
  std::vector<glm::vec3> out(none.size());
  GlossyShading(lighting, 64)(none, none, none, out);
}

TEST_CASE("a triangle's values between its corners are those of exact arithmetic, of slivers too") {
  std::mt19937 random(5);
  const auto at = [&](int most) {
    return std::int64_t(std::uniform_int_distribution(-most, most)(random));
  };
  std::uniform_real_distribution<float> depth(0.2f, 5.f);
  std::vector<Varying> values(3);
  values[0].uv = {1, 0}, values[1].uv = {0, 1}, values[2].uv = {0, 0};
  int slivers = 0;
  for (int i = 0; i < 20000; ++i) {
    PictureCorner v[3];
    const int most = i % 2 ? 1 << 20 : 1 << 12;
    for (PictureCorner& p : v) p = {at(most), at(most), depth(random), true};
    if (i % 4 > 1)  // nearly on a line
      v[2].x = (v[0].x + 3 * v[1].x) / 4 + at(1), v[2].y = (v[0].y + 3 * v[1].y) / 4 + at(1);
    const std::int64_t area = edge(v[0], v[1], v[2].x, v[2].y);
    if (area == 0) continue;
    const std::int64_t px = (v[0].x + v[1].x + v[2].x) / 3, py = (v[0].y + v[1].y + v[2].y) / 3;
    long double w[3];
    for (int k = 0; k < 3; ++k)
      w[k] = v[k].inverse_depth *
             ((long double)edge(v[(k + 1) % 3], v[(k + 2) % 3], px, py) / (long double)area);
    if (w[0] < 0 || w[1] < 0 || w[2] < 0) continue;
    slivers += std::abs(area) < most;
    const DrawnTriangle triangle(0, {0, 1, 2}, v[0], v[1], v[2]);
    const int x = int(px >> 8), y = int(py >> 8);
    const TrianglePart part{0, x, y, 1, int(px - x * 256), int(py - y * 256)};
    Varying mean;
    interpolate({&part, 1}, &triangle, values.data(), &mean);
    const glm::vec3 shares = triangle.shares(px, py);
    for (int k = 0; k < 2; ++k) {
      const float expected = float(w[k] / (w[0] + w[1] + w[2]));
      CHECK(std::abs(mean.uv[k] - expected) < 2e-4f);
      CHECK(std::abs(shares[k] - expected) < 2e-4f);
    }
  }
  MESSAGE(slivers, " slivers");
  CHECK(slivers > 100);
}

TEST_CASE("a tag that is projected millions of pixels large is no match, and costs no memory") {
  const BoardPattern pattern = pattern_of(Board::default_board());
  const Image<std::uint8_t> picture(640, 480, 1, 100);
  const LightTable table(Response::srgb(), 1);
  const LightReader light(picture.view(), table);
  for (const double size : {1e3, 1e6, 1e9, 1e15}) {
    ProjectedTag tag{0, {}, size};
    const int n = pattern.nodes();
    for (int k = 0; k < n * n; ++k) tag.nodes.push_back(size * glm::dvec2(k % n - 3, k / n - 3));
    CHECK(find_tags(light, pattern, {&tag, 1}, 64).empty());
  }
}

// Whether a sphere blocks the light that a point of the plane gets from a direction.
static bool hides(const glm::dvec4& sphere, const glm::dvec3& light, const glm::dvec2& point) {
  const glm::dvec3 q = glm::dvec3(sphere) - glm::dvec3(point, 0);
  const double along = glm::dot(q, light), r2 = sphere.w * sphere.w;
  return glm::dot(q, q) < r2 || (along > 0 && glm::dot(q, q) - along * along < r2);
}

TEST_CASE("bits of spheres are those of a ray per texel, but for edges that pass its centre") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto between = [&](double low, double high) { return low + (high - low) * unit(random); };
  int dark = 0, lit = 0, at_edges = 0;
  for (int scene = 0; scene < 60; ++scene) {
    const PlaneGrid grid{
        int(between(1, 170)), {float(between(-1, 1)), float(between(-1, 1))}, 1.5f};
    // The later scenes have many spheres at once, some that the plane cuts, and some too large for
    // float.
    const int count = scene < 20 ? 1 + scene % 3 : int(between(1, 200));
    const double size = count > 30 ? 0.08 : 0.4;
    SphereSet spheres;
    for (int i = 0; i < count; ++i) {
      const double r = size * between(0.1, 1);
      spheres.push_back(glm::vec4(between(-1.5, 1.5), between(-1.5, 1.5),
                                  scene % 2 ? r + between(0, 1) : between(-1.2 * r, 1.5), r));
    }
    if (scene % 10 == 9) spheres.push_back({0, 0, -3e3f, 2999.8f});
    const glm::dvec3 light = glm::normalize(
        glm::dvec3(glm::vec3(between(-1, 1), scene % 7 ? between(-1, 1) : 0, between(0.05, 1))));
    PlaneBits bits(grid.size);
    PlaneSpheres(spheres, grid).add_shadow(glm::vec3(light), bits);
    const double texel = grid.texel(), near = 0.02 * texel;
    int wrong = 0;
    for (int y = 0; y < grid.size; ++y)
      for (int x = 0; x < grid.size; ++x) {
        const glm::dvec2 at =
            glm::dvec2(grid.centre) + texel * (glm::dvec2(x, y) - 0.5 * grid.size + 0.5);
        const auto dark_at = [&](const glm::dvec2& p) {
          for (const glm::vec4& s : spheres)
            if (hides(glm::dvec4(s), light, p)) return true;
          return false;
        };
        const bool expected = dark_at(at);
        ++(expected ? dark : lit);
        if (bits.at(x, y) == expected) continue;
        bool edge = false;
        for (const glm::dvec2& d :
             {glm::dvec2(near, 0), glm::dvec2(-near, 0), glm::dvec2(0, near), glm::dvec2(0, -near)})
          edge = edge || dark_at(at + d) != expected;
        ++(edge ? at_edges : wrong);
      }
    CAPTURE(scene);
    CHECK(wrong == 0);
    const PlaneBits::Box& box = bits.box();
    for (int y = 0; y < grid.size; ++y)
      for (int x = 0; x < grid.size; ++x)
        if (bits.at(x, y))
          CHECK((y >= box.first_row && y <= box.last_row && x / 64 >= box.first_column &&
                 x / 64 <= box.last_column));
    bits.clear();
    CHECK(bits == PlaneBits(grid.size));
  }
  MESSAGE(dark, " dark, ", lit, " lit, ", at_edges, " of them otherwise at an edge");
  CHECK((dark > 10000 && lit > 10000 && at_edges < (dark + lit) / 10000));
}

TEST_CASE("bits of hidden cells are those of the runs, on finer and coarser grids") {
  std::mt19937 random(5);
  for (const int own : {16, 32, 64}) {
    std::vector<bool> hidden(std::size_t(own) * std::size_t(own));
    std::vector<std::uint16_t> edges;
    std::uniform_int_distribution<int> gap(1, 90);
    for (std::size_t k = 0; k < hidden.size(); k += std::size_t(gap(random))) {
      edges.push_back(std::uint16_t(k));
      for (const std::size_t end = std::min(hidden.size(), k + std::size_t(gap(random))); k < end;)
        hidden[k++] = true;
      edges.push_back(std::uint16_t(k));
    }
    for (const int size : {16, 32, 64}) {
      HiddenCells cells(size);
      cells.set(edges, own);
      int wrong = 0;
      const int parts = own * own / (size * size);  // own cells in one; 0: several in an own one
      for (int k = 0; k < size * size; ++k) {
        CHECK((cells.masks()[k / 16] >> (k % 16) & 1) == cells[k]);
        if (parts <= 1) {
          wrong += cells[k] != hidden[std::size_t(k) * std::size_t(own * own) / (size * size)];
          continue;
        }
        int count = 0;  // a run's ends move by half a cell at most
        for (int i = 0; i < parts; ++i) count += hidden[std::size_t(k * parts + i)];
        wrong += (count == 0 && cells[k]) || (count == parts && !cells[k]);
      }
      CHECK(wrong == 0);
    }
  }
}

TEST_CASE(
    "triangles cover the samples that the exact edge functions say, without gaps or overlap") {
  std::mt19937 random(1);
  constexpr int kEdge = 96;  // pixels; larger triangles than 64 take another path
  for (const int spread : {12, 60, 95}) {
    std::uniform_int_distribution<int> place(0, spread * kSubpixel);
    for (int round = 0; round < 60; ++round) {
      PictureCorner v[4];
      for (PictureCorner& c : v)
        c.x = place(random), c.y = place(random), c.inverse_depth = 1, c.valid = true;
      std::vector<SampleCell> cells(kEdge * kEdge);
      const SampleWindow window{cells.data(), 0, 0, kEdge - 1, kEdge - 1};
      fill_triangle(window, v[0], v[1], v[2], 7);
      const std::int64_t area = edge(v[0], v[1], v[2].x, v[2].y);
      int wrong = 0;
      for (int y = 0; y < kEdge; ++y)
        for (int x = 0; x < kEdge; ++x)
          for (int s = 0; s < kSamples; ++s) {
            const std::int64_t px = x * kSubpixel + kSampleX[s], py = y * kSubpixel + kSampleY[s];
            bool in = area != 0, on = false;
            for (int k = 0; k < 3; ++k) {
              const std::int64_t e = edge(v[k], v[(k + 1) % 3], px, py) * (area < 0 ? -1 : 1);
              in = in && e >= 0, on = on || e == 0;
            }
            const bool got = cells[std::size_t(y * kEdge + x)].triangle[std::size_t(s)] == 7;
            wrong += on ? got && !in : got != in;
          }
      CHECK(wrong == 0);
      // Two triangles of a quad: each sample on their common edge belongs to one of them.
      std::vector<SampleCell> first(kEdge * kEdge), second(kEdge * kEdge);
      fill_triangle({first.data(), 0, 0, kEdge - 1, kEdge - 1}, v[0], v[1], v[2], 1);
      fill_triangle({second.data(), 0, 0, kEdge - 1, kEdge - 1}, v[2], v[1], v[3], 1);
      const std::int64_t side = edge(v[1], v[2], v[3].x, v[3].y);
      if ((area > 0) == (side > 0)) continue;  // both lie on the same side of the edge
      for (std::size_t i = 0; i < first.size(); ++i)
        for (std::size_t s = 0; s < kSamples; ++s)
          wrong += first[i].triangle[s] == 1 && second[i].triangle[s] == 1;
      CHECK(wrong == 0);
    }
  }
}

TEST_CASE("near lights that hardly moved are taken where they were, others are not") {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.1f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  SceneOptions options;
  options.sphere_count = 0;
  const Scene scene = make_scene(mesh, Material{}, {}, options);
  Lighting lighting;
  lighting.irradiance.polynomial[0] = glm::vec3(1);
  const auto light_at = [](float turn, float irradiance) {
    return NearLight{{std::sin(turn), 0, std::cos(turn)}, 2.0f, 0.05f, glm::vec3(irradiance)};
  };
  NearShares kept;
  lighting.near_lights.lights = {light_at(0.3f, 1)};
  kept.update(scene, lighting, SharesOf::directions);
  const auto differs = [&](NearLight light) {
    lighting.near_lights.lights = {light};
    const auto a = kept.update(scene, lighting, SharesOf::directions);
    const auto b = NearShares().update(scene, lighting, SharesOf::directions);
    float most = 0, largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
      most = std::max(most, std::abs(a[i].x - b[i].x)),
      largest = std::max(largest, std::abs(b[i].x));
    MESSAGE("off by ", most, " of ", largest);
    REQUIRE(largest > 0.01f);
    return most / largest;
  };
  CHECK(differs(light_at(0.3f, 3)) == 0);
  const float small = differs(light_at(0.3f + 0.9f * NearShares::kKeptAngle, 3));
  CHECK(small > 0);
  CHECK(small < 0.01f);
  CHECK(differs(light_at(0.3f + 3 * NearShares::kKeptAngle, 3)) == 0);
  CHECK(differs(light_at(1.0f, 1)) == 0);
}

TEST_CASE("what near lights change has another version where anything but a brightness is new") {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.1f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  SceneOptions options;
  options.sphere_count = 0;
  Scene scene = make_scene(mesh, Material{}, {}, options);
  Lighting lighting;
  lighting.irradiance.polynomial[0] = glm::vec3(1);
  const auto light_at = [](float turn, float irradiance) {
    return NearLight{{std::sin(turn), 0, std::cos(turn)}, 2.0f, 0.05f, glm::vec3(irradiance)};
  };
  NearShares shares;
  const auto renewed = [&](std::vector<NearLight> lights) {
    const std::uint64_t before = shares.version();
    lighting.near_lights.lights = std::move(lights);
    shares.update(scene, lighting, SharesOf::directions);
    REQUIRE(shares.lights().size() == lighting.near_lights.lights.size());
    for (std::size_t i = 0; i < shares.lights().size(); ++i)
      CHECK(shares.lights()[i].light.irradiance == lighting.near_lights.lights[i].irradiance);
    return shares.version() != before;
  };
  CHECK(renewed({light_at(0.3f, 1), light_at(1, 1)}));
  CHECK(!renewed({light_at(0.3f, 5), light_at(1, 2)}));
  CHECK(renewed({light_at(1, 2), light_at(0.3f, 5)}));
  CHECK(renewed({light_at(1, 2)}));
  CHECK(!renewed({light_at(1, 3)}));
  scene.marker_from_object.translation.x = 0.01;
  CHECK(renewed({light_at(1, 3)}));
  CHECK(renewed({}));
  NearShares other;
  lighting.near_lights.lights = {light_at(1, 3)};
  other.update(scene, lighting, SharesOf::directions);
  CHECK(other.version() != shares.version());
}

TEST_CASE("a light in a lobe is finite at its middle, within it and beside it") {
  const LobeHeight lobe(LobeShape{});
  const glm::vec3 up(0, 0, 1), view = glm::normalize(glm::vec3(0.2f, 0, 1));
  float last = 0;
  for (const float distance : {4.0f, 1.0f, 0.1f, 0.05f, 1e-20f, 0.0f}) {
    const float seen = disc_in_lobe(distance * up, 0.1f, 1, up, view, lobe);
    CHECK(std::isfinite(seen));
    CHECK(seen >= 0.99f * last);  // the closer, the more
    last = seen;
  }
}

TEST_CASE("pieces of a map hold all of its light, none much more than a count's part of it") {
  constexpr int n = 32, kCount = 200;
  std::vector<glm::vec3> faces(6 * n * n, glm::vec3(0.2f, 0.3f, 0.5f));
  SUBCASE("black") { faces.assign(faces.size(), glm::vec3(0)); }
  SUBCASE("of one colour") {
    for (glm::vec3& f : faces) f = {0, 0.7f, 0};
  }
  SUBCASE("with a sun in one texel") {
    faces[4 * n * n + 7 * n + 20] = glm::vec3(1e6f, 8e5f, 6e5f);
  }
  SUBCASE("with a red and a blue lamp") {
    faces[100] = {5e3f, 0, 0}, faces[3 * n * n + 50] = {0, 0, 2e3f};
  }
  SUBCASE("even") {}
  const CubeMap map(n, faces);
  const LightPieces pieces(map, glm::mat3(1), kCount);
  const LitDirections& lit = pieces.directions();
  CHECK(lit.count % kLanes == 0);
  CHECK(pieces.count() <= 20 * kCount);
  glm::dvec3 all(0), sum(0);
  const std::vector<double> angles = texel_solid_angles(n);
  for (std::size_t i = 0; i < faces.size(); ++i) all += angles[i % (n * n)] * glm::dvec3(faces[i]);
  double most = 0;
  for (std::size_t i = 0; i < lit.count; ++i)
    for (int c = 0; c < 3; ++c) {
      sum[c] += double(lit.channels[c][i]);
      if (all[c] > 0) most = std::max(most, double(lit.channels[c][i]) / all[c]);
    }
  for (int c = 0; c < 3; ++c) CHECK(sum[c] == doctest::Approx(all[c]).epsilon(1e-4));
  CHECK(most <= 1.3 / kCount);
  for (std::size_t i = 0; i < lit.count; ++i)
    CHECK(std::abs(lit.x[i] * lit.x[i] + lit.y[i] * lit.y[i] + lit.z[i] * lit.z[i] - 1) < 1e-5f);
}
