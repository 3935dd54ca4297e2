#include "fastibl/render/gl/pixel_shares.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string>

#include "fastibl/render/gl/tables.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/light_sums.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {
namespace {

constexpr int kTriangle = 4;  // texels of a triangle in shared/tree.glsl,
constexpr int kAtOnce = 4;    // and triangles that it looks at in a step

glm::uvec3 bits(glm::vec3 v) {
  return {std::bit_cast<GLuint>(v.x), std::bit_cast<GLuint>(v.y), std::bit_cast<GLuint>(v.z)};
}
glm::uvec2 halves(std::uint64_t v) { return {GLuint(v), GLuint(v >> 32)}; }

bool same(std::span<const glm::vec4> a, std::span<const glm::vec4> b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

}  // namespace

bool PixelShares::find(Gpu& gpu, LightTextures& light, const PixelParts& parts,
                       const RenderInput& in) {
  const Scene& scene = in.scene;
  const bool rays = in.methods.self_shadow == SelfShadowMethod::traced_lights;
  if (!has(in.methods.self_shadow) || !in.cell_light ||
      !can_ask(scene, *in.cell_light, in.self_shares) ||
      (rays ? !(scene.bvh && in.lighting.radiance) : in.near_shares != nullptr))
    return false;
  const std::optional<LobeShape> shape = scene.material.lobe();
  if (rays && known_.keep(scene, *in.lighting.radiance, *in.cell_light)) entries_of_ = {};
  if (!shape && (!rays || known_.cells().empty())) return false;
  std::optional<LobeCells> lobe;
  if (shape)
    lobe.emplace(*in.cell_light, *shape,
                 rays ? std::span<const int>(known_.cells().indices()) : std::span<const int>());
  upload(gpu, scene, lobe, rays);
  const Irradiance& e = in.lighting.irradiance;
  const int variant =
      rays && scene.material.reads_irradiance() ? irradiance_variant(gpu, e.method) : 0;
  // Beside each other where they fit, or else all in a column or a row.
  columns_ = 2 * parts.visible.width > gpu.largest()    ? 1
             : 2 * parts.visible.height > gpu.largest() ? 4
                                                        : 2;
  const int rows = 4 / columns_;
  gpu.allocate(shares_, GL_RGBA16F, columns_ * parts.visible.width, rows * parts.visible.height,
               GL_RGBA, GL_HALF_FLOAT);
  std::optional<NearTracer> near;
  if (rays && in.near_shares) near.emplace(scene, *in.near_shares);
  const Program& p = gpu.use(
      "pixel_shares",
      {"DIFFUSE " + std::to_string(variant), "LOBE " + std::to_string(shape ? 1 + shape->ggx : 0),
       rays ? "RAYS 1" : "RAYS 0", near ? "NEAR 1" : "NEAR 0", distortion(*in.camera)});
  light.set_irradiance(gpu, p, variant, e);
  if (lobe) bind_lobe(gpu, p, *lobe, *shape);
  if (!near && without_near_)
    upload_bright(gpu, known_.cells(), known_.cells()), without_near_ = false;
  if (rays) bind_rays(gpu, p, in);
  if (near) bind_near(gpu, p, *near, *in.near_shares, scene);
  const Pose camera_from_object = in.camera_from_marker * scene.marker_from_object;
  parts.bind(gpu, p, *in.camera, camera_from_object, curved_cosine(scene.material));
  gpu.bind("entries", entries_);
  const int vertices = int(scene.mesh.vertices.size());
  glUniform1i(p.uniform("own_vertices"), vertices);
  glUniform1i(p.uniform("back_entries"), scene.directions->sides > 1 ? vertices : 0);
  set_tiles(p, parts.area);
  set(p, "eye", glm::vec3(camera_from_object.inverse().translation));
  gpu.target(0, shares_);
  gpu.draw_full_screen(columns_ * parts.area.width(), rows * parts.area.height());
  return true;
}

void PixelShares::set_tiles(const Program& p, const Area& area) const {
  glUniform2i(p.uniform("tile"), area.width(), area.height());
  glUniform1i(p.uniform("columns"), columns_);
}

void PixelShares::bind(Gpu& gpu, const Program& p, const Area& area) const {
  gpu.bind("pixel_shares", shares_);
  set_tiles(p, area);
}

void PixelShares::upload(Gpu& gpu, const Scene& scene, const std::optional<LobeCells>& lobe,
                         bool rays) {
  if (rays && tree_of_ != scene.bvh) {
    tree_of_ = nullptr;  // until it is there
    upload_tree(gpu, *scene.bvh);
    tree_of_ = scene.bvh;
  }
  const int size = lobe ? lobe->size() : 0;
  if (lobe && masks_of_ != Masks{scene.directions, size}) {
    masks_of_ = {};
    masks_.keep(scene.directions, size);
    std::vector<glm::uvec4> words((masks_.all().size() + 7) / 8);
    std::memcpy(words.data(), masks_.all().data(), masks_.all().size() * sizeof masks_.all()[0]);
    upload_table(gpu, lobe_masks_, words);
    masks_of_ = {scene.directions, size};
  }
  if (entries_of_ != Entries{{scene.directions, size}, rays}) {
    entries_of_ = {};
    upload_entries(gpu, scene, rays, lobe.has_value());
    if (rays) upload_bright(gpu, known_.cells(), known_.cells());
    entries_of_ = {{scene.directions, size}, rays};
  }
}

void PixelShares::upload_entries(Gpu& gpu, const Scene& scene, bool rays, bool masks) {
  std::vector<glm::uvec4> table;
  const std::size_t vertices = scene.normals.size(), count = scene.directions->entries();
  table.reserve(4 * count);
  for (std::size_t e = 0; e < count; ++e) {
    const CellStates states = rays ? known_.states()[e] : CellStates{};
    const glm::vec3 normal = e < vertices ? scene.normals[e] : -scene.normals[e - vertices];
    table.emplace_back(halves(states.hidden), halves(states.low));
    table.emplace_back(halves(states.free), halves(states.mixed));
    const glm::vec3 origin = e < scene.origins.size() ? scene.origins[e] : glm::vec3(0);
    table.emplace_back(bits(origin), GLuint(masks ? masks_.first(e) : 0));
    table.emplace_back(bits(normal), 0u);
  }
  upload_table(gpu, entries_, table);
}

void PixelShares::upload_tree(Gpu& gpu, const Bvh& bvh) {
  const std::vector<Bvh::Node>& nodes = bvh.nodes();
  std::vector<int> next(nodes.size());  // where a node is left
  for (std::size_t i = nodes.size(); i-- > 0;)
    next[i] = nodes[i].count > 0 ? int(i) + 1 : next[std::size_t(nodes[i].first)];
  std::vector<glm::vec4> table, triangles;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Bvh::Node& n = nodes[i];
    table.emplace_back(n.lower, next[i]);
    table.emplace_back(n.upper, n.count > 0 ? int(triangles.size()) / kTriangle : -1);
    const int whole = (n.count + kAtOnce - 1) / kAtOnce * kAtOnce;
    for (int k = 0; k < whole; ++k) {
      const Bvh::Corner c =
          k < n.count ? bvh.corners()[std::size_t(n.first + k)] : Bvh::Corner{{}, {}, {}, 0};
      triangles.emplace_back(c.origin, k / kAtOnce == (whole - 1) / kAtOnce);
      triangles.emplace_back(c.edge1, 0);
      triangles.emplace_back(c.edge2, 0);
      triangles.emplace_back(glm::cross(c.edge2, c.edge1), 0);
    }
  }
  table.insert(table.end(), triangles.begin(), triangles.end());
  upload_table(gpu, tree_, table);
}

void PixelShares::upload_bright(Gpu& gpu, const BrightCells& cells, const BrightCells& for_lobes) {
  std::vector<glm::vec4> table;
  for (std::size_t i = 0; i < cells.cells().size(); ++i) {
    const BrightCells::Cell& c = cells.cells()[i];
    table.emplace_back(c.direction, c.first);
    table.emplace_back(c.moments[0], c.count);
    table.emplace_back(c.moments[1], c.first_count);
    table.emplace_back(c.moments[2], c.share / float(c.count));
    table.emplace_back(for_lobes.left(i), 0, 0, 0);
  }
  for (std::size_t r = 0; r < cells.rays().size(); ++r)
    table.emplace_back(cells.rays()[r], for_lobes.is_left_out(r) ? 0 : 1);
  upload_table(gpu, bright_, table);
}

void PixelShares::upload_lobe(Gpu& gpu, const LobeCells& lobe) {
  const LobeCells::Cells& cells = lobe.cells();
  std::vector<glm::vec4> table;
  for (std::size_t k = 0; k < cells.group_x.size(); ++k)
    table.emplace_back(cells.group_x[k], cells.group_y[k], cells.group_z[k], lobe.flux().groups[k]);
  for (std::size_t k = 0; k < cells.x.size(); ++k)
    table.emplace_back(cells.x[k], cells.y[k], cells.z[k], lobe.flux().cells[k]);
  upload_table(gpu, lobe_cells_, table);
}

void PixelShares::bind_lobe(Gpu& gpu, const Program& p, const LobeCells& lobe,
                            const LobeShape& shape) {
  const LobeCells::Cells& cells = lobe.cells();
  if (lobe_flux_ != lobe.flux().cells) {
    lobe_flux_.clear();  // until it is uploaded
    upload_lobe(gpu, lobe);
    lobe_flux_ = lobe.flux().cells;
  }
  gpu.bind("lobe_cells", lobe_cells_);
  gpu.bind("lobe_masks", lobe_masks_);
  glUniform1i(p.uniform("lobe_groups"), cells.groups);
  glUniform1f(p.uniform("lobe_reach"), lobe.reach());
  glUniform1f(p.uniform("cell_half_exponent"), lobe.half_exponent());
  glUniform1f(p.uniform("cell_alpha2"), lobe.alpha2());
  const LobeHeight height(shape, LightTracer::kSharpest);
  glUniform1f(p.uniform("lobe_exponent"), height.exponent);
  glUniform1f(p.uniform("lobe_least"), height.least);
  glUniform1f(p.uniform("lobe_alpha2"), height.alpha2);
}

void PixelShares::bind_rays(Gpu& gpu, const Program& p, const RenderInput& in) {
  gpu.bind("tree", tree_);
  gpu.bind("bright", bright_);
  glUniform1i(p.uniform("tree_nodes"), int(in.scene.bvh->nodes().size()));
  glUniform1i(p.uniform("bright_cells"), int(known_.cells().cells().size()));
  glUniform1f(p.uniform("cell_width"), known_.cells().width());
  set(p, "marker_from_object", glm::mat3(in.scene.marker_from_object.rotation));
  glUniform1f(p.uniform("ray_offset"), ray_offset(in.scene.mesh));
  const bool others = in.light_shares.size() == in.self_shares.size() &&
                      (in.near_shares || !same(in.light_shares, in.self_shares));
  glUniform1i(p.uniform("has_others"), others);
  if (others && !same(own_, in.self_shares)) {
    own_.clear();  // until it is uploaded
    std::vector<glm::vec4> table(in.self_shares.begin(), in.self_shares.end());
    upload_table(gpu, self_shares_, table);
    own_.assign(in.self_shares.begin(), in.self_shares.end());
  }
  if (others) gpu.bind("self_shares", self_shares_);
}

void PixelShares::bind_near(Gpu& gpu, const Program& p, const NearTracer& near,
                            const NearShares& shares, const Scene& scene) {
  const std::vector<NearTracer::Light>& lights = near.lights();
  Near now{shares.version(), {}};
  for (const NearTracer::Light& l : lights) now.lights.push_back(l.of - shares.lights().data());
  if (!(now == near_of_)) {
    near_of_ = {};  // until it is uploaded
    std::vector<glm::uvec4> table(2 * scene.directions->entries(), glm::uvec4(0));
    for (std::size_t e = 0; e < scene.directions->entries(); ++e) {
      GLuint* texels = &table[2 * e].x;
      for (std::size_t i = 0; i < lights.size(); ++i) {
        texels[0] |= GLuint(lights[i].of->states[e]) << (2 * i);
        texels[1 + i] = std::bit_cast<GLuint>(lights[i].of->changes[e]);
      }
    }
    upload_table(gpu, near_entries_, table);
    near_of_ = std::move(now);
  }
  const NearCells of_cells(near, known_.cells());
  upload_bright(gpu, known_.cells(), of_cells.others());
  without_near_ = true;
  std::vector<glm::uvec4> table;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const NearTracer::Light& l = lights[i];
    table.emplace_back(bits(l.direction), std::bit_cast<GLuint>(l.inverse_distance));
    table.emplace_back(bits(l.irradiance), std::bit_cast<GLuint>(l.sin_radius));
    table.emplace_back(halves(of_cells.cells(i)), std::bit_cast<GLuint>(of_cells.flux(i)), 0u);
  }
  for (std::size_t c = 0; c < known_.cells().cells().size(); ++c) {
    std::array<GLuint, 8> parts{};
    for (std::size_t i = 0; i < lights.size(); ++i)
      parts[i] = std::bit_cast<GLuint>(of_cells.parts(i)[c]);
    table.emplace_back(parts[0], parts[1], parts[2], parts[3]);
    table.emplace_back(parts[4], parts[5], parts[6], parts[7]);
  }
  upload_table(gpu, near_lights_, table);
  gpu.bind("near_lights", near_lights_);
  gpu.bind("near_entries", near_entries_);
  glUniform1i(p.uniform("near_count"), int(lights.size()));
  set(p, "near_centre", near.centre());
}

}  // namespace fastibl
