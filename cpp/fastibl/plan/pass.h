// The passes of a frame, and what they read and write.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace fastibl {

// What passes read and write, as bits. The first row comes from outside.
using Products = std::uint32_t;
namespace product {
inline constexpr Products back_picture = 1, light_pictures = 2, placement = 4, material = 8;
inline constexpr Products pose = 16, texels = 32, radiance = 64, irradiance = 128, shadow = 256,
                          object = 512, image = 1024, self_shadow = 2048, bounce = 4096,
                          plane = 8192, holdout = 16384, near_light = 32768;
inline constexpr Products inputs = 15, all = 65535;
}  // namespace product

enum class PassId {
  track,
  capture,
  mips,
  irradiance,
  shadow,
  self_shadow,
  near_light,  // the object's light by the place of its parts, not only by their orientation
  bounce,
  plane,    // factor on the plane's picture, where that is not the plain shadow
  holdout,  // the shadow on real objects
  shade,
  composite
};
inline constexpr std::array kPasses = {PassId::track,      PassId::capture, PassId::mips,
                                       PassId::irradiance, PassId::shadow,  PassId::self_shadow,
                                       PassId::near_light, PassId::bounce,  PassId::plane,
                                       PassId::holdout,    PassId::shade,   PassId::composite};
std::string_view name(PassId id);

struct Pass {
  PassId id;
  Products reads;  // a change of these makes what it writes stale
  Products
      needs;  // must be fresh before it runs, but do not make it run: pictures bring their own pose
  Products writes;
};

}  // namespace fastibl
