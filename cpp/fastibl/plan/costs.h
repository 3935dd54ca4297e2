// What each pass costs: a table of unit costs, and the time of a pass by this table.
#pragma once

#include <array>
#include <string_view>

#include "fastibl/plan/pass.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

// Nanoseconds of one core. The values here are those of one machine (Zen 4, 2 GHz), for choices
// that must not depend on the machine; render/measure_costs.h measures others.
struct Costs {
  // For each map.
  double fold = 84e3, faces = 4e3, sh9 = 6e3, lobes = 79e3, lobe = 13e3, cube = 150e3;
  double chain = 1.13e6, lights = 0.39e6, exact_chain = 23e6, mips = 300e3;
  // For each pixel of the object, by what it reads.
  double read_faces = 1.8, read_sh9 = 1.5, read_lobe = 0.05, read_cube = 4.7;
  double mip = 8.5, look_up = 15, more_look_ups = 9.6, light = 3.9, sample = 39, ggx = 190;
  double raster_pixel = 47, raster_vertex = 220;
  double composite_pixel = 2.1, shadow_pixel = 3.2;
  double shadow_texel = 2;  // made ready to be looked up
  // For the shadow: of a baked mesh, of one with a finer map, of one direction.
  double mesh_shadow = 370e3, fine_shadow = 1.95e6, direction = 3.5e3, caps = 7.8e6;
  // For what the object hides from itself; for a lobe at a vertex and at a pixel, by Workload's
  // groups.
  double cells = 90e3, share_edge = 0.9, vertex_group = 18, pixel_group = 38;
  double traced_pixel = 25e3, light_ray = 80, bright_ray = 5;
  double bounce = 175e3, bounce_group = 3.2, plane_texel = 4.1;
  // For the cameras' pictures.
  double track = 1.4e6, capture_pixel = 3;
  bool operator==(const Costs&) const = default;
};
struct CostField {
  std::string_view name;
  double Costs::*value;
};
// All of them, for files and printing.
const std::array<CostField, 41>& cost_fields();

// The rays of SelfShadowMethod::traced_lights.
struct LightRays {
  double traced = 6;   // in the mean of the object's pixels
  double summed = 40;  // likewise, of glossy light
};

// Parts of pixels that show the object, one for each triangle in a pixel; and those that are
// shaded, where some are shaded as one.
struct PartCounts {
  double found = 50000, shaded = 25000;
};

// The work in a frame.
struct Workload {
  int width = 640, height = 480;           // of the picture
  int cameras = 2;                         // whose pictures go into the map
  double camera_pixels = 2 * 640 * 480.0;  // of them all
  PartCounts object = {};
  double shadow_pixels = 307200;  // of the plane
  int vertices = 3000;
  double entries = 3000, edges = 240e3;  // of VertexVisibility
  double groups = 110e3;                 // of PlaneExchange
  double lobe_groups = 12;               // of cells, see shading/lobe_cells.h
  LightRays rays = {};
  int lights = 4;             // taken out of a chain, at most
  bool light_changes = true;  // in every frame, as captured light does
  bool pbr = false, glossy = true, diffuse = true;
};
// The number of frames that one fit of constant light serves.
inline constexpr double kFramesPerLight = 300;

double pass_milliseconds(const Costs& costs, PassId pass, const Methods& methods,
                         const Workload& workload);
// How often a pass runs in a frame.
double runs_per_frame(PassId pass, const Workload& workload);

}  // namespace fastibl
