#include "fastibl/plan/candidates.h"

namespace fastibl {

Candidates candidates(const Methods& asked, const CandidateOptions& options) {
  Candidates all;
  const bool rough = options.light_stays || options.hurried;
  const auto cube = [](int size, int source) {
    return DiffuseCandidate{DiffuseMethod::irradiance_cube, {-1, size, source}};
  };
  if (asked.diffuse != DiffuseMethod::automatic) {
    all.diffuse = {{asked.diffuse, asked.diffuse_settings}};
  } else {
    all.diffuse = {cube(8, 16), cube(16, 16), cube(16, 32)};
    if (rough) all.diffuse.insert(all.diffuse.begin(), {DiffuseMethod::sh9, {}});
    if (options.light_stays) {
      for (const int lobes : {2, 4, 8})
        all.diffuse.push_back({DiffuseMethod::sh9_lobes, {lobes, 16, 32}});
      all.diffuse.push_back(cube(32, 32));
    }
  }
  if (asked.glossy != GlossyMethod::automatic || !options.glossy) {
    all.glossy = {{asked.glossy, asked.glossy_settings}};
  } else {
    all.glossy = {{GlossyMethod::centroid, {0, 0}},   {GlossyMethod::centroid, {0, -1}},
                  {GlossyMethod::stretched, {2, -1}}, {GlossyMethod::stretched, {3, -1}},
                  {GlossyMethod::sampled, {64, -1}},  {GlossyMethod::sampled, {256, -1}}};
    if (options.offline) all.glossy.push_back({GlossyMethod::sampled, {1024, -1}});
    if (options.pbr)
      std::erase_if(all.glossy,
                    [](const GlossyCandidate& g) { return g.method == GlossyMethod::stretched; });
    if (rough) all.glossy.insert(all.glossy.begin(), {GlossyMethod::mip, {}});
    if (options.light_stays) {
      all.glossy.push_back({GlossyMethod::prefiltered, {1, -1}});
      if (!options.pbr) all.glossy.push_back({GlossyMethod::prefiltered, {3, -1}});
    }
    if (options.placed)
      std::erase_if(all.glossy, [](const GlossyCandidate& g) {
        if (g.method == GlossyMethod::sampled) return false;
        const bool takes_out =
            g.method == GlossyMethod::centroid || g.method == GlossyMethod::stretched;
        return !takes_out || g.settings.lights == 0;
      });
  }
  if (asked.self_shadow != SelfShadowMethod::automatic) {
    all.self_shadow = {asked.self_shadow};
  } else {
    all.self_shadow = {SelfShadowMethod::none, SelfShadowMethod::ambient,
                       SelfShadowMethod::transfer};
    if (options.glossy) all.self_shadow.push_back(SelfShadowMethod::pixel_transfer);
    all.self_shadow.push_back(SelfShadowMethod::traced_lights);
    if (options.offline && options.traced)
      all.self_shadow.push_back(SelfShadowMethod::traced);
  }
  if (asked.shadow != ShadowMethod::automatic)
    all.shadow = {{asked.shadow, asked.shadow_settings}};
  else if (options.baked_shadow)
    all.shadow = {{ShadowMethod::directions, {32}},
                  {ShadowMethod::mesh, {}},
                  {ShadowMethod::mesh, {256, 512}}};
  else
    all.shadow = {{ShadowMethod::directions, {32}},
                  {ShadowMethod::directions, {64}},
                  {ShadowMethod::directions, {256}},
                  {ShadowMethod::directions, {1024}}};
  if (asked.bounce != BounceMethod::automatic)
    all.bounce = {asked.bounce};
  else
    all.bounce = {BounceMethod::none, BounceMethod::one};
  return all;
}

}  // namespace fastibl
