#include "fastibl/plan/costs.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

const std::array<CostField, 41>& cost_fields() {
  static constexpr std::array<CostField, 41> fields = {
      {{"fold", &Costs::fold},
       {"faces", &Costs::faces},
       {"sh9", &Costs::sh9},
       {"lobes", &Costs::lobes},
       {"lobe", &Costs::lobe},
       {"cube", &Costs::cube},
       {"chain", &Costs::chain},
       {"lights", &Costs::lights},
       {"exact_chain", &Costs::exact_chain},
       {"mips", &Costs::mips},
       {"read_faces", &Costs::read_faces},
       {"read_sh9", &Costs::read_sh9},
       {"read_lobe", &Costs::read_lobe},
       {"read_cube", &Costs::read_cube},
       {"mip", &Costs::mip},
       {"look_up", &Costs::look_up},
       {"more_look_ups", &Costs::more_look_ups},
       {"light", &Costs::light},
       {"sample", &Costs::sample},
       {"ggx", &Costs::ggx},
       {"raster_pixel", &Costs::raster_pixel},
       {"raster_vertex", &Costs::raster_vertex},
       {"composite_pixel", &Costs::composite_pixel},
       {"shadow_pixel", &Costs::shadow_pixel},
       {"shadow_texel", &Costs::shadow_texel},
       {"mesh_shadow", &Costs::mesh_shadow},
       {"fine_shadow", &Costs::fine_shadow},
       {"direction", &Costs::direction},
       {"caps", &Costs::caps},
       {"cells", &Costs::cells},
       {"share_edge", &Costs::share_edge},
       {"vertex_group", &Costs::vertex_group},
       {"pixel_group", &Costs::pixel_group},
       {"traced_pixel", &Costs::traced_pixel},
       {"light_ray", &Costs::light_ray},
       {"bright_ray", &Costs::bright_ray},
       {"bounce", &Costs::bounce},
       {"bounce_group", &Costs::bounce_group},
       {"plane_texel", &Costs::plane_texel},
       {"track", &Costs::track},
       {"capture_pixel", &Costs::capture_pixel}}};
  return fields;
}

namespace {

double irradiance_cost(const Costs& c, const Methods& m) {
  const DiffuseSettings& s = m.diffuse_settings;
  switch (m.diffuse) {
    case DiffuseMethod::nearest_face:
    case DiffuseMethod::six_face:
    case DiffuseMethod::six_face_exact:
      return c.fold + c.faces;
    case DiffuseMethod::sh9:
      return c.fold + c.sh9;
    case DiffuseMethod::sh9_lobes:
      return c.fold + c.sh9 + c.lobes + c.lobe * (s.lobes < 0 ? 4 : s.lobes);
    default:
      return c.fold +
             c.cube * (s.size / 16.0) * (s.size / 16.0) * (s.source / 32.0) * (s.source / 32.0);
  }
}

double chain_cost(const Costs& c, const Methods& m) {
  switch (m.glossy) {
    case GlossyMethod::mip:
    case GlossyMethod::sampled:
      return 0;
    case GlossyMethod::prefiltered:
      return c.exact_chain;
    default:
      return c.chain + (m.glossy_settings.lights == 0 ? 0 : c.lights);
  }
}

double diffuse_pixel(const Costs& c, const Methods& m) {
  switch (m.diffuse) {
    case DiffuseMethod::sh9:
      return c.read_sh9;
    case DiffuseMethod::sh9_lobes:
      return c.read_sh9 +
             c.read_lobe * (m.diffuse_settings.lobes < 0 ? 4 : m.diffuse_settings.lobes);
    case DiffuseMethod::irradiance_cube:
    case DiffuseMethod::automatic:
      return c.read_cube;
    default:
      return c.read_faces;
  }
}

double glossy_pixel(const Costs& c, const Methods& m, const Workload& w) {
  const GlossySettings& s = m.glossy_settings;
  const double lights = c.light * (s.lights < 0 ? w.lights : std::min(s.lights, w.lights));
  if (w.pbr && m.glossy != GlossyMethod::sampled) return c.ggx;
  switch (m.glossy) {
    case GlossyMethod::mip:
      return c.mip;
    case GlossyMethod::stretched:
      return c.look_up + c.more_look_ups * (std::max(s.taps, s.taps == 0 ? 3 : 1) - 1) + lights;
    case GlossyMethod::sampled:
      return c.sample * (s.taps == 0 ? 64 : s.taps);
    case GlossyMethod::prefiltered:
      return c.look_up + c.more_look_ups * ((s.taps == 0 ? 3 : s.taps) - 1);
    default:
      return c.look_up + lights;
  }
}

double shadow_cost(const Costs& c, const Methods& m) {
  switch (m.shadow) {
    case ShadowMethod::mesh:
      return m.shadow_settings.fine > 0 ? c.fine_shadow : c.mesh_shadow;
    case ShadowMethod::cap_sum:
    case ShadowMethod::cap_product:
      return c.caps;
    default:
      return c.direction * m.shadow_settings.directions;
  }
}

// Texels of a baked shadow's three maps, or of a cast one's two.
double shadow_texels(const Methods& m) {
  constexpr double kTexels = 128 * 128;
  const double fine = m.shadow_settings.fine;
  return m.shadow == ShadowMethod::mesh ? 2 * kTexels + fine * fine : 1.25 * kTexels;
}

}  // namespace

double pass_milliseconds(const Costs& c, PassId pass, const Methods& m, const Workload& w) {
  constexpr double kTouched = 0.6;  // of an object's pixels: those whose lobes meet the object
  constexpr double kPlaced = 0.9;   // of drawing a part
  const double pixels = double(w.width) * w.height;
  const bool transfer = knows_directions(m.self_shadow);
  double ns = 0;
  switch (pass) {
    case PassId::track:
      ns = c.track;
      break;
    case PassId::capture:
      ns = c.capture_pixel * w.camera_pixels;
      break;
    case PassId::mips:
      ns = c.mips;
      break;
    case PassId::irradiance:
      ns = irradiance_cost(c, m) + (w.glossy ? chain_cost(c, m) : 0);
      break;
    case PassId::shadow:
      ns = shadow_cost(c, m);
      break;
    case PassId::self_shadow:
      ns = c.cells + c.share_edge * w.edges;
      break;
    case PassId::bounce:
      ns = c.bounce + c.bounce_group * w.groups;
      break;
    case PassId::plane:
      ns = c.plane_texel * shadow_texels(m);
      break;
    case PassId::shade:
      ns = c.raster_vertex * w.vertices +
           w.object.shaded * (c.raster_pixel + (w.diffuse ? diffuse_pixel(c, m) : 0) +
                              (w.glossy ? glossy_pixel(c, m, w) : 0)) +
           (w.glossy && transfer ? c.vertex_group * w.lobe_groups * w.entries : 0);
      // Rays go from every part, whose place on its triangle is found before, and which are put
      // together afterwards.
      if (traces_rays(m.self_shadow)) ns += kPlaced * c.raster_pixel * w.object.found;
      if (m.self_shadow == SelfShadowMethod::traced) ns += c.traced_pixel * w.object.found;
      if (m.self_shadow == SelfShadowMethod::traced_lights) {
        // Rays were measured with a mesh of 2400 vertices; trees of more are deeper.
        const double depth = std::log(std::max(w.vertices, 8)) / std::log(2400.0);
        ns += (c.light_ray * depth * w.rays.traced + c.bright_ray * w.rays.summed) * w.object.found;
      }
      if (has_pixel_lobes(m.self_shadow) && w.glossy)
        ns += c.pixel_group * w.lobe_groups * kTouched *
              (traces_rays(m.self_shadow) ? w.object.found : w.object.shaded);
      break;
    case PassId::composite:
      ns = c.composite_pixel * pixels + c.shadow_pixel * w.shadow_pixels;
      if (w.light_changes) ns += c.shadow_texel * shadow_texels(m);
      break;
    default:
      break;
  }
  return ns * 1e-6;
}

double runs_per_frame(PassId pass, const Workload& workload) {
  switch (pass) {
    case PassId::track:
    case PassId::shade:
    case PassId::composite:
      return 1;
    default:
      return workload.light_changes ? 1 : 1 / kFramesPerLight;
  }
}

}  // namespace fastibl
