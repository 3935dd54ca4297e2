#include "fastibl/shading/shade.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// Where the plane may be shadowed, in pixels: the projected outline of the shadow map, cut to the
// picture.
struct Rectangle {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

Rectangle shadowed_pixels(const Camera& camera, const Pose& camera_from_marker,
                          const ShadowMap& shadow) {
  if (shadow.ratio.empty() || shadow.no_light) return {};
  const Lens lens(camera);
  glm::dvec2 lower(std::numeric_limits<double>::infinity()), upper(-lower);
  constexpr int kSteps = 16;  // of each edge: lenses bend them
  for (int side = 0; side < 4; ++side)
    for (int k = 0; k < kSteps; ++k) {
      const double a = 2.0 * k / kSteps - 1;
      const glm::dvec2 p = side == 0   ? glm::dvec2(a, -1)
                           : side == 1 ? glm::dvec2(1, a)
                           : side == 2 ? glm::dvec2(-a, 1)
                                       : glm::dvec2(-1, -a);
      const auto pixel =
          lens.project(camera_from_marker *
                       glm::dvec3(glm::dvec2(shadow.centre) + double(shadow.extent) * p, 0));
      if (!pixel)
        return {0, 0, camera.width, camera.height};  // partly behind the camera: look everywhere
      lower = glm::min(lower, *pixel), upper = glm::max(upper, *pixel);
    }
  const auto clamp = [](double value, int limit) {
    return int(std::clamp(value, 0.0, double(limit)));
  };
  return {
      clamp(std::floor(lower.x) - 1, camera.width), clamp(std::floor(lower.y) - 1, camera.height),
      clamp(std::ceil(upper.x) + 1, camera.width), clamp(std::ceil(upper.y) + 1, camera.height)};
}

// Ratio of the plane point that a pixel sees; 1 where it sees none. The camera must be above the
// plane.
class PlaneShadow {
 public:
  PlaneShadow(const RayTable& table, const Pose& camera_from_marker, const ShadowMap& shadow)
      : table_(table),
        shadow_(shadow),
        area_(shadowed_pixels(table.camera, camera_from_marker, shadow)) {
    const Pose marker_from_camera = camera_from_marker.inverse();
    rotation_ = glm::mat3(marker_from_camera.rotation);
    eye_ = glm::vec3(marker_from_camera.translation);
    if (!(eye_.z > 0)) area_ = {};
  }
  glm::vec3 operator()(int x, int y) const {
    if (x < area_.x0 || x >= area_.x1 || y < area_.y0 || y >= area_.y1) return glm::vec3(1);
    const glm::vec3 d =
        rotation_ * table_.rays[std::size_t(y) * table_.camera.width + std::size_t(x)];
    if (!(d.z < 0)) return glm::vec3(1);
    return shadow_.sample(shared::plane_point(eye_, d));
  }
  const Rectangle& area() const { return area_; }

 private:
  const RayTable& table_;
  const ShadowMap& shadow_;
  Rectangle area_;
  glm::mat3 rotation_;
  glm::vec3 eye_;
};

Rectangle around(const Rectangle& a, const ObjectLayer& object) {
  if (object.rgba.empty()) return a;
  const Rectangle b{object.x, object.y, object.x + object.rgba.width,
                    object.y + object.rgba.height};
  if (a.x0 >= a.x1 || a.y0 >= a.y1) return b;
  return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

glm::vec4 object_at(const ObjectLayer& object, int x, int y) {
  const int ox = x - object.x, oy = y - object.y;
  if (ox < 0 || oy < 0 || ox >= object.rgba.width || oy >= object.rgba.height) return glm::vec4(0);
  const float* p = object.rgba.pixel(ox, oy);
  return {p[0], p[1], p[2], p[3]};
}

float exposure_at(const Camera& camera, double exposure, int x, int y) {
  const double base = exposure * camera.gain;
  return float(camera.vignetting.empty() ? base : base * camera.vignette({x + 0.5, y + 0.5}));
}

}  // namespace

glm::vec3 shade(const Fragment& f, const Material& material, const Lighting& lighting,
                glm::vec3 eye) {
  glm::vec3 colour = material.emission;
  if (material.diffuse != glm::vec3(0))
    colour += material.diffuse * (f.visibility / kPi) * evaluate(lighting.irradiance, f.normal);
  if (material.glossy != glm::vec3(0))
    colour +=
        material.glossy *
        evaluate_glossy(lighting, f.normal, glm::normalize(eye - f.position), material.exponent);
  return colour;
}

ObjectLayer shade(std::span<const Fragment> fragments, const Material& material,
                  const Lighting& lighting, glm::vec3 eye) {
  ObjectLayer layer;
  if (fragments.empty()) return layer;
  int x0 = fragments[0].x, x1 = x0, y0 = fragments[0].y, y1 = y0;
  for (const Fragment& f : fragments) {
    x0 = std::min(x0, f.x), x1 = std::max(x1, f.x);
    y0 = std::min(y0, f.y), y1 = std::max(y1, f.y);
  }
  layer.x = x0, layer.y = y0;
  layer.rgba = Image<float>(x1 - x0 + 1, y1 - y0 + 1, 4);
  std::vector<glm::vec3> colours(fragments.size());
  parallel_for(int(fragments.size()), 2048, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      colours[std::size_t(i)] = shade(fragments[std::size_t(i)], material, lighting, eye);
  });
  for (std::size_t i = 0; i < fragments.size(); ++i) {
    const Fragment& f = fragments[i];
    float* p = layer.rgba.pixel(f.x - x0, f.y - y0);
    for (int c = 0; c < 3; ++c) p[c] += f.coverage * colours[i][c];
    p[3] += f.coverage;
  }
  return layer;
}

RayTable::RayTable(const Camera& c)
    : camera(c), rays(std::size_t(c.width) * std::size_t(c.height)) {
  const Lens lens(camera);
  parallel_for(camera.height, 16, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const auto ray = lens.unproject({x + 0.5, y + 0.5});
        rays[std::size_t(y) * camera.width + std::size_t(x)] =
            ray ? glm::vec3(*ray) : glm::vec3(std::numeric_limits<float>::quiet_NaN());
      }
  });
}

Image<std::uint8_t> composite(const Picture& back, double exposure, const RayTable& table,
                              const Pose& camera_from_marker, const ObjectLayer& object,
                              const ShadowMap& shadow) {
  const Camera& camera = table.camera;
  const ByteResponse response(camera.response);
  Image<std::uint8_t> out = back.empty() ? Image<std::uint8_t>(camera.width, camera.height, 3)
                                         : bytes_from(back, camera.response);
  const PlaneShadow plane(table, camera_from_marker, shadow);
  const Rectangle area = around(plane.area(), object);
  parallel_for(area.y1 - area.y0, 16, [&](int begin, int end) {
    for (int y = area.y0 + begin; y < area.y0 + end; ++y)
      for (int x = area.x0; x < area.x1; ++x) {
        const glm::vec4 o = object_at(object, x, y);
        const glm::vec3 ratio = o.w < 1 ? plane(x, y) : glm::vec3(1);
        if (o.w == 0 && ratio == glm::vec3(1)) continue;
        std::uint8_t* p = out.pixel(x, y);
        const float scale = o.w > 0 ? exposure_at(camera, exposure, x, y) : 0.0f;
        // 16-bit and float pictures are darkened in their rounded codes too: their output has 8
        // bits.
        for (int c = 0; c < 3; ++c)
          p[c] = response.encode(scale * o[c] + (1 - o.w) * ratio[c] * response.decode(p[c]));
      }
  });
  return out;
}

Image<std::uint8_t> matte(double exposure, const RayTable& table, const Pose& camera_from_marker,
                          const ObjectLayer& object, const ShadowMap& shadow) {
  const Camera& camera = table.camera;
  const ByteResponse response(camera.response);
  Image<std::uint8_t> out(camera.width, camera.height, 4);
  const PlaneShadow plane(table, camera_from_marker, shadow);
  const Rectangle area = around(plane.area(), object);
  for (int y = area.y0; y < area.y1; ++y)
    for (int x = area.x0; x < area.x1; ++x) {
      const glm::vec4 o = object_at(object, x, y);
      const glm::vec3 ratio = o.w < 1 ? plane(x, y) : glm::vec3(1);
      const float darkness = 1 - (ratio.x + ratio.y + ratio.z) / 3;
      const float alpha = o.w + (1 - o.w) * darkness;
      if (alpha <= 0) continue;
      std::uint8_t* p = out.pixel(x, y);
      for (int c = 0; c < 3; ++c)
        p[c] = response.encode(exposure_at(camera, exposure, x, y) * o[c] / alpha);
      p[3] = std::uint8_t(std::lround(255 * alpha));
    }
  return out;
}

}  // namespace fastibl
