// What each pass takes: a table of unit costs, and the time of a pass by it.
#pragma once

#include <array>
#include <string_view>

#include "fastibl/plan/pass.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

// Nanoseconds of one core. The values here are those of one machine (Zen 4, 2 GHz), for choices
// that must not depend on where they are made; render/measure_costs.h measures others.
struct Costs {
  // Of a map.
  double fold = 50e3, faces = 5e3, sh9 = 8e3, lobes = 20e3, lobe = 30e3, cube = 110e3;
  double chain = 1.2e6, lights = 350e3, exact_chain = 30e6, mips = 1e6;
  // Of a pixel of the object, by what it reads.
  double read_faces = 3, read_sh9 = 1.5, read_lobe = 1, read_cube = 5;
  double mip = 25, look_up = 42, more_look_ups = 24, light = 14, sample = 27, ggx = 1200;
  double raster_pixel = 65, raster_vertex = 450;
  double composite_pixel = 3.5, shadow_pixel = 8;
  // Of the shadow: of a baked mesh, with a finer map, of one direction.
  double mesh_shadow = 250e3, fine_shadow = 1.6e6, direction = 2e3, caps = 6e6;
  // Of what the object hides of itself.
  double cells = 40e3, share_vertex = 32, glossy_vertex = 65;
  double bounce = 10e3, bounce_vertex = 380;
  // Of cameras' pictures.
  double track = 1.5e6, capture_pixel = 8;
  bool operator==(const Costs&) const = default;
};
struct CostField {
  std::string_view name;
  double Costs::*value;
};
// All of them, for files and printing.
const std::array<CostField, 35>& cost_fields();

// What there is to do in a frame.
struct Workload {
  int width = 640, height = 480;  // of the picture
  double object_pixels = 25000, shadow_pixels = 60000;
  int vertices = 3000;
  bool light_changes = true;  // every frame, as where it is captured
  bool pbr = false, glossy = true, diffuse = true;
};
// Frames that one fitting of light that stays is for.
inline constexpr double kFramesPerLight = 300;

double pass_milliseconds(const Costs& costs, PassId pass, const Methods& methods,
                         const Workload& workload);
// How often a pass runs in a frame.
double runs_per_frame(PassId pass, const Workload& workload);

}  // namespace fastibl
