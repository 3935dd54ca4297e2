#include "fastibl/capture/wide_picture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/wide_lens.h"

namespace fastibl {
namespace {

constexpr int kMargin = 4;        // pixels around a side, at least
constexpr double kFootprint = 2;  // texels that a footprint may reach across, at most
constexpr double kFinest = 16;    // pixels of half a side per texel of the map, at most
constexpr int kLeastTexels = 4;   // that the map is taken to have
constexpr WideSide::Source kNothing = {-1, -1};
bool is_nothing(const WideSide::Source& source) { return source.y < 0; }

// Camera from side: the axes of the cube's sides, x right, y down, z outwards.
constexpr int kSides = 6;
glm::dmat3 side_axes(int side) {
  const glm::dvec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  switch (side) {
    case 0:
      return {x, y, z};
    case 1:
      return {-z, y, x};
    case 2:
      return {z, y, -x};
    case 3:
      return {x, -z, y};
    case 4:
      return {x, z, -y};
    default:
      return {-x, y, -z};
  }
}

std::size_t bytes_of(PixelType type) {
  return type == PixelType::uint8 ? 1 : type == PixelType::uint16 ? 2 : 4;
}

}  // namespace

std::vector<WideSide> sides_of(const Camera& wide, int texels) {
  const WideLens lens(wide);
  // As fine as the middle of the picture, where a side is 2 focal lengths wide, or, if that is
  // coarser, much finer than the map.
  const double focal =
      std::min(std::ceil(std::max(wide.fx, wide.fy)), kFinest * std::max(texels, kLeastTexels));
  const int reach = kMargin + int(std::ceil(kFootprint * 2 * focal / texels));
  const int half = int(focal) + reach, size = 2 * half;
  std::vector<WideSide> sides;
  for (int k = 0; k < kSides; ++k) {
    WideSide side;
    const glm::dmat3 camera_from_side = side_axes(k);
    side.camera.width = side.camera.height = size;
    side.camera.fx = side.camera.fy = focal;
    side.camera.cx = side.camera.cy = half;
    side.camera.response = wide.response, side.camera.gain = wide.gain;
    side.side_from_camera.rotation = glm::transpose(camera_from_side);
    if (!wide.vignetting.empty()) side.vignette.assign(std::size_t(size) * std::size_t(size), 1);
    side.from.assign(std::size_t(size) * std::size_t(size), kNothing);
    parallel_for(size, 16, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < size; ++x) {
          const glm::dvec3 ray((x + 0.5 - half) / focal, (y + 0.5 - half) / focal, 1);
          const auto pixel = lens.project(camera_from_side * ray);
          if (!pixel || !wide.inside(*pixel)) continue;
          const std::size_t i = std::size_t(y) * std::size_t(size) + std::size_t(x);
          side.from[i] = {int(pixel->x), int(pixel->y)};
          if (!side.vignette.empty()) side.vignette[i] = float(wide.vignette(*pixel));
        }
    });
    side.own = Image<std::uint8_t>(size, size, 1);
    // A footprint that reaches beyond the wide picture would read nothing there, so such texels are
    // left out. Sums run along rows, then columns.
    std::vector<std::int32_t> nothing(side.from.size());
    const auto at = [&](int x, int y) {
      return std::size_t(y) * std::size_t(size) + std::size_t(x);
    };
    const auto clamped = [&](int i) { return std::clamp(i, 0, size - 1); };
    for (int y = 0; y < size; ++y) {
      int count = 0;
      for (int x = -reach; x <= reach; ++x) count += is_nothing(side.from[at(clamped(x), y)]);
      for (int x = 0; x < size; ++x) {
        nothing[at(x, y)] = count;
        count += is_nothing(side.from[at(clamped(x + reach + 1), y)]);
        count -= is_nothing(side.from[at(clamped(x - reach), y)]);
      }
    }
    bool any = false;
    for (int x = 0; x < size; ++x) {
      std::int64_t count = 0;
      for (int y = -reach; y <= reach; ++y) count += nothing[at(x, clamped(y))];
      for (int y = 0; y < size; ++y) {
        const bool inside = x >= reach && y >= reach && x < size - reach && y < size - reach;
        side.own.data[at(x, y)] = inside && count == 0;
        any |= inside && count == 0;
        count += nothing[at(x, clamped(y + reach + 1))] - nothing[at(x, clamped(y - reach))];
      }
    }
    if (any) sides.push_back(std::move(side));
  }
  return sides;
}

void SidePicture::take(const WideSide& side, const Picture& wide,
                       ImageView<const std::uint8_t> mask) {
  const std::size_t pixel = 3 * bytes_of(wide.type), count = side.from.size();
  pixels_.resize(pixel * count);
  const auto copy = [&](auto size) {
    parallel_for(side.camera.height, 64, [&](int begin, int end) {
      const std::size_t width = std::size_t(side.camera.width);
      for (std::size_t i = std::size_t(begin) * width; i < std::size_t(end) * width; ++i) {
        const WideSide::Source& from = side.from[i];
        if (is_nothing(from))
          std::memset(&pixels_[i * size()], 0, size());
        else
          std::memcpy(&pixels_[i * size()], wide.row(from.y) + std::size_t(from.x) * size(),
                      size());
      }
    });
  };
  if (wide.type == PixelType::uint8)
    copy(std::integral_constant<std::size_t, 3>());
  else if (wide.type == PixelType::uint16)
    copy(std::integral_constant<std::size_t, 6>());
  else
    copy(std::integral_constant<std::size_t, 12>());
  picture_ = {pixels_.data(), wide.type, side.camera.width, side.camera.height,
              std::ptrdiff_t(pixel) * side.camera.width};
  mask_ = side.own.view();
  hidden_ = {};
  if (mask.empty()) return;
  masked_ = Image<std::uint8_t>(side.camera.width, side.camera.height, 1, 1);
  for (std::size_t i = 0; i < count; ++i)
    if (!is_nothing(side.from[i])) masked_.data[i] = *mask.pixel(side.from[i].x, side.from[i].y);
  hidden_ = PictureMask(masked_.view());
  for (std::size_t i = 0; i < count; ++i)
    if (!side.own.data[i]) masked_.data[i] = 0;
  mask_ = masked_.view();
}

}  // namespace fastibl
