#include "fastibl/shading/composite.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/pixel_reader.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// Where the plane may be shadowed, in pixels: the projected outline of the shadow map, cut to the
// picture.
struct Rectangle {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

Rectangle shadowed_pixels(const Camera& camera, const Pose& camera_from_marker,
                          const ShadowLookUp& shadow) {
  if (shadow.empty()) return {};
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
                       glm::dvec3(glm::dvec2(shadow.centre()) + double(shadow.reach()) * p, 0));
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

// The plane points x, y that `count` rays (x, y, 1) meet; NaN for rays that do not descend. m:
// rotation from camera to marker, row by row, and eye.
FASTIBL_CLONES
void meet_plane(const float* x, const float* y, int count, const float (&m)[12],
                float* __restrict points) {
  const float down = -m[11];
  for (int i = 0; i < count; ++i) {
    const float dx = m[0] * x[i] + m[1] * y[i] + m[2], dy = m[3] * x[i] + m[4] * y[i] + m[5];
    const float dz = m[6] * x[i] + m[7] * y[i] + m[8], met = down / dz;
    const float t = dz < 0 ? met : std::numeric_limits<float>::quiet_NaN();
    points[2 * i] = m[9] + t * dx;
    points[2 * i + 1] = m[10] + t * dy;
  }
}

// Ratios of the plane points that rows of pixels see; 1 where they see none. The camera must be
// above the plane.
class PlaneShadow {
 public:
  PlaneShadow(const PixelTable& table, const Pose& camera_from_marker, const ShadowLookUp& shadow)
      : table_(table),
        look_up_(shadow),
        area_(shadowed_pixels(table.camera, camera_from_marker, shadow)) {
    const Pose marker_from_camera = camera_from_marker.inverse();
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) transform_[3 * r + c] = float(marker_from_camera.rotation[c][r]);
      transform_[9 + r] = float(marker_from_camera.translation[r]);
    }
    if (!(marker_from_camera.translation.z > 0)) area_ = {};
  }
  const Rectangle& area() const { return area_; }

  // Ratios of pixels [x0, x0 + ratios.size()) of row y.
  void row(int y, int x0, std::vector<glm::vec3>& ratios) const {
    std::fill(ratios.begin(), ratios.end(), glm::vec3(1));
    const int begin = std::max(x0, area_.x0),
              count = std::min(x0 + int(ratios.size()), area_.x1) - begin;
    if (y < area_.y0 || y >= area_.y1 || count <= 0) return;
    std::vector<glm::vec2> points(static_cast<std::size_t>(count));
    const std::size_t first = std::size_t(y) * table_.camera.width + std::size_t(begin);
    meet_plane(&table_.x[first], &table_.y[first], count, transform_, &points[0].x);
    look_up_.sample(points, std::span(ratios).subspan(std::size_t(begin - x0), points.size()));
  }

 private:
  const PixelTable& table_;
  const ShadowLookUp& look_up_;
  Rectangle area_;
  float transform_[12];
};

Rectangle around(const Rectangle& a, const ObjectLayer& object) {
  if (object.rgba.empty()) return a;
  const Rectangle b{object.x, object.y, object.x + object.rgba.width,
                    object.y + object.rgba.height};
  if (a.x0 >= a.x1 || a.y0 >= a.y1) return b;
  return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

void check_within(const ObjectLayer& layer, const Camera& camera, const char* which) {
  if (layer.rgba.empty()) return;
  check(layer.x >= 0 && layer.y >= 0 && layer.rgba.width <= camera.width - layer.x &&
            layer.rgba.height <= camera.height - layer.y && layer.rgba.channels == 4,
        which, " must lie in the picture of ", camera.width, " × ", camera.height, ", got ",
        layer.rgba.width, " × ", layer.rgba.height, " at ", layer.x, ", ", layer.y);
}

// A row of a layer; columns count from x0.
struct LayerRow {
  LayerRow(const ObjectLayer& layer, int x0, int y) {
    if (y < layer.y || y >= layer.y + layer.rgba.height) return;
    begin = layer.x - x0, end = begin + layer.rgba.width;
    pixels = layer.rgba.row(y - layer.y);
  }
  glm::vec4 at(int x) const {
    if (x < begin || x >= end) return glm::vec4(0);
    const float* p = pixels + 4 * (x - begin);
    return {p[0], p[1], p[2], p[3]};
  }
  int begin = 0, end = 0;
  const float* pixels = nullptr;
};

FASTIBL_CLONES
void multiply(const float* a, const float* b, int count, float* __restrict out) {
  for (int i = 0; i < count; ++i) out[i] = a[i] * b[i];
}

// Writes the codes that changed. What is beyond the response's levels, black and white, stays there
// unless its code becomes another one.
FASTIBL_CLONES
void keep_changed(const std::uint8_t* codes, std::uint8_t black, std::uint8_t white, int count,
                  std::uint8_t* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const std::uint8_t above = out[i] < black ? black : out[i];
    out[i] = codes[i] == (above > white ? white : above) ? out[i] : codes[i];
  }
}

// Draws a row of a layer over linear pixels. light: what its radiance is multiplied by, and by
// `vignette` where there is one.
FASTIBL_CLONES
void draw_over(const float* layer, int count, float light, const float* vignette,
               float* __restrict pixels) {
  for (int i = 0; i < count; ++i) {
    const float *o = layer + 4 * i, factor = vignette ? light * vignette[i] : light;
    for (int c = 0; c < 3; ++c) pixels[3 * i + c] = factor * o[c] + (1 - o[3]) * pixels[3 * i + c];
  }
}

// Whether all factors lie between two others.
FASTIBL_CLONES
bool all_between(const float* factors, int count, float least, float most) {
  int outside = 0;
  for (int i = 0; i < count; ++i) outside += !(factors[i] >= least && factors[i] <= most);
  return outside == 0;
}

// Ratio of what is seen beside the object. A real object h covers a part of it with its own ratio.
glm::vec3 with_holdout(glm::vec3 plane, float object, glm::vec4 h) {
  const float free = 1 - object;
  if (h.w == 0 || !(free > 0)) return plane;
  return (glm::vec3(h) + std::max(free - h.w, 0.0f) * plane) / free;
}

float exposure_at(const PixelTable& table, double exposure, int x, int y) {
  const double base = exposure * table.camera.gain;
  if (table.vignette.empty()) return float(base);
  return float(base * table.vignette[std::size_t(y) * table.camera.width + std::size_t(x)]);
}

}  // namespace

PixelTable::PixelTable(const Camera& c)
    : camera(c),
      response(c.response),
      x(std::size_t(c.width) * std::size_t(c.height)),
      y(x.size()),
      vignette(c.vignetting.empty() ? 0 : x.size()) {
  const Lens lens(camera);
  parallel_for(camera.height, 16, [&](int begin, int end) {
    for (int row = begin; row < end; ++row)
      for (int column = 0; column < camera.width; ++column) {
        const auto ray = lens.unproject({column + 0.5, row + 0.5});
        const std::size_t i = std::size_t(row) * camera.width + std::size_t(column);
        x[i] = ray ? float(ray->x) : std::numeric_limits<float>::quiet_NaN();
        y[i] = ray ? float(ray->y) : std::numeric_limits<float>::quiet_NaN();
        if (!vignette.empty()) vignette[i] = float(camera.vignette({column + 0.5, row + 0.5}));
      }
  });
}

Image<std::uint8_t> composite(const Picture& back, double exposure, const PixelTable& table,
                              const Pose& camera_from_marker, const ObjectLayer& object,
                              const ShadowLookUp& shadow, const ObjectLayer& holdout) {
  Image<std::uint8_t> out;
  composite(back, exposure, table, camera_from_marker, object, shadow, holdout, out);
  return out;
}

void composite(const Picture& back, double exposure, const PixelTable& table,
               const Pose& camera_from_marker, const ObjectLayer& object,
               const ShadowLookUp& shadow, const ObjectLayer& holdout, Image<std::uint8_t>& out) {
  const Camera& camera = table.camera;
  check(back.empty() || (back.width == camera.width && back.height == camera.height),
        "the picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
        back.width, " × ", back.height);
  check_within(object, camera, "the object");
  check_within(holdout, camera, "the holdout");
  const bool bytes = back.empty() || back.type == PixelType::uint8;
  const PixelReader pixels(back, camera.response, table.response);
  if (back.empty())
    out = Image<std::uint8_t>(camera.width, camera.height, 3);
  else
    bytes_from(back, camera.response, out);
  const PlaneShadow plane(table, camera_from_marker, shadow);
  const Rectangle area = around(around(plane.area(), object), holdout);
  constexpr int kStretch = 64;  // pixels that are blended together
  parallel_for(area.y1 - area.y0, 16, [&](int begin, int end) {
    const int width = area.x1 - area.x0;
    std::vector<glm::vec3> ratios(static_cast<std::size_t>(width));
    std::array<glm::vec3, kStretch> before, after;
    std::array<std::uint8_t, 3 * kStretch> codes;
    for (int y = area.y0 + begin; y < area.y0 + end; ++y) {
      plane.row(y, area.x0, ratios);
      const LayerRow hidden(holdout, area.x0, y), drawn(object, area.x0, y);
      for (int x = hidden.begin; x < hidden.end; ++x)
        ratios[std::size_t(x)] = with_holdout(ratios[std::size_t(x)], drawn.at(x).w, hidden.at(x));
      const auto blend = [&](int first, int last) {
        std::uint8_t* p = out.pixel(area.x0 + first, y);
        const int count = last - first, values = 3 * count;
        if (bytes)
          table.response.decode(p, &before[0].x, std::size_t(values));
        else  // what lies beyond white stays so in the shade
          for (int i = 0; i < count; ++i)
            before[std::size_t(i)] = pixels.linear(area.x0 + first + i, y);
        multiply(&ratios[std::size_t(first)].x, &before[0].x, values, &after[0].x);
        const int from = std::max(first, drawn.begin), to = std::min(last, drawn.end);
        if (from < to)
          draw_over(
              drawn.pixels + 4 * (from - drawn.begin), to - from, float(exposure * camera.gain),
              table.vignette.empty() ? nullptr
                                     : table.vignette.data() + y * camera.width + area.x0 + from,
              &after[std::size_t(from - first)].x);
        table.response.encode(&after[0].x, codes.data(), std::size_t(values));
        keep_changed(codes.data(), table.response.encode(0), table.response.encode(1), values, p);
      };
      // Most of the plane changes its brightness by less than a code.
      for (int x = 0; x < width; x += kStretch) {
        const int last = std::min(x + kStretch, width);
        if ((x >= drawn.end || last <= drawn.begin) &&
            all_between(&ratios[std::size_t(x)].x, 3 * (last - x), table.response.least_unseen(),
                        table.response.most_unseen()))
          continue;
        blend(x, last);
      }
    }
  });
}

void bare_picture(const Picture& back, const Camera& camera, Image<std::uint8_t>& out) {
  if (back.empty())
    out = Image<std::uint8_t>(camera.width, camera.height, 4);
  else
    bytes_from(back, camera.response, out);
}

Image<std::uint8_t> matte(double exposure, const PixelTable& table, const Pose& camera_from_marker,
                          const ObjectLayer& object, const ShadowLookUp& shadow,
                          const ObjectLayer& holdout) {
  const Camera& camera = table.camera;
  Image<std::uint8_t> out(camera.width, camera.height, 4);
  const PlaneShadow plane(table, camera_from_marker, shadow);
  const Rectangle area = around(around(plane.area(), object), holdout);
  std::vector<glm::vec3> ratios(std::size_t(area.x1 - area.x0));
  for (int y = area.y0; y < area.y1; ++y) {
    plane.row(y, area.x0, ratios);
    const LayerRow hidden(holdout, area.x0, y), drawn(object, area.x0, y);
    for (int x = area.x0; x < area.x1; ++x) {
      const glm::vec4 o = drawn.at(x - area.x0);
      const glm::vec3 ratio =
          with_holdout(ratios[std::size_t(x - area.x0)], o.w, hidden.at(x - area.x0));
      const float alpha = o.w + (1 - o.w) * shared::shadow_alpha(ratio);
      if (alpha <= 0) continue;
      std::uint8_t* p = out.pixel(x, y);
      for (int c = 0; c < 3; ++c)
        p[c] = table.response.encode(exposure_at(table, exposure, x, y) * o[c] / alpha);
      p[3] = std::uint8_t(std::lround(255 * alpha));
    }
  }
  return out;
}

PictureLayers picture_layers(double exposure, const PixelTable& table,
                             const Pose& camera_from_marker, const ObjectLayer& object,
                             const ShadowLookUp& shadow, const ObjectLayer& holdout) {
  const Camera& camera = table.camera;
  PictureLayers out{Image<float>(camera.width, camera.height, 4),
                    Image<float>(camera.width, camera.height, 3)};
  const PlaneShadow plane(table, camera_from_marker, shadow);
  parallel_for(camera.height, 16, [&](int begin, int end) {
    std::vector<glm::vec3> ratios(static_cast<std::size_t>(camera.width));
    for (int y = begin; y < end; ++y) {
      plane.row(y, 0, ratios);
      const LayerRow hidden(holdout, 0, y), drawn(object, 0, y);
      for (int x = 0; x < camera.width; ++x) {
        const glm::vec4 o = drawn.at(x);
        const glm::vec3 ratio = with_holdout(ratios[std::size_t(x)], o.w, hidden.at(x));
        const float light = exposure_at(table, exposure, x, y);
        float *layer = out.object.pixel(x, y), *plate = out.ratio.pixel(x, y);
        for (int c = 0; c < 3; ++c) layer[c] = light * o[c], plate[c] = ratio[c];
        layer[3] = o.w;
      }
    }
  });
  return out;
}

}  // namespace fastibl
