// Plans with any inputs, and a short life of a Session: changes and frames in any order.
#include "fastibl/render/session.h"

#include <stdexcept>

#include "fastibl/render/make_scene.h"
#include "meshes.h"
#include "pictures.h"

namespace fastibl {
namespace {

Material material(Input& in) {
  const auto colour = [&] { return in.chance(6) ? in.any3() : glm::vec3(in.share()); };
  if (in.chance(3)) {
    PbrMaterial pbr;
    pbr.base_color = colour();
    pbr.metallic = in.chance(6) ? in.any() : in.share();
    pbr.roughness = in.chance(6) ? in.any() : in.share();
    pbr.anisotropy = in.chance(4) ? 1.0f : 0.0f;
    [[maybe_unused]] static const auto kept =
        std::pair(GgxAlbedo::of(0), GgxAlbedo::of(1));  // kept, because the tables take long
    if (in.chance(6)) pbr.emission = colour();
    return Material::make_pbr(pbr);
  }
  Material m;
  m.diffuse = in.chance(4) ? glm::vec3(0) : colour();
  m.glossy = in.chance(2) ? glm::vec3(0) : colour();
  m.exponent = in.chance(4) ? in.any() : std::exp2(20 * in.share());
  if (in.chance(6)) m.emission = colour();
  m.validate();
  return m;
}

Methods methods(Input& in) {
  if (in.chance(3)) return Methods::paper();
  Methods m;
  if (in.chance(2)) m.diffuse = DiffuseMethod(in.below(7));
  if (in.chance(2)) m.glossy = GlossyMethod(in.below(6));
  if (in.chance(2)) m.normalization = Normalization(in.below(3));
  if (in.chance(2)) m.shadow = ShadowMethod(in.below(4));  // not `mesh`: nothing is baked
  if (in.chance(2)) m.self_shadow = SelfShadowMethod(in.below(4));
  if (in.chance(2)) m.bounce = BounceMethod(in.below(3));
  m.capture = in.chance(3) ? CaptureMethod::single : CaptureMethod::continuous;
  m.shadow_settings.directions = 16;
  return m;
}

void plan_only(Input& in, const Scene& scene) {
  PlanOptions options;
  options.methods = methods(in);
  options.track = in.chance(2), options.capture = in.chance(2), options.cast_shadow = in.chance(2);
  options.error = in.any_double(), options.milliseconds = in.any_double();
  const Environment environment = environment_from(any_map(in, 4));
  const Plan plan = make_plan(scene, in.chance(2) ? &environment : nullptr, options);
  require(plan.passes.size() == kPasses.size(), "every pass has its line");
  for (const PlannedPass& p : plan.passes)
    require(p.included || !p.reason.empty(), "what is left out has its reason");
  Products stale = Products(in.below(65536));
  const Products wanted = Products(in.below(65536));
  due_passes(plan, wanted, stale);
  require(due_passes(plan, wanted & ~product::inputs, stale).empty() || (stale & product::inputs),
          "nothing is due twice");
}

std::shared_ptr<const Environment> any_environment(Input& in) {
  return std::make_shared<const Environment>(environment_from(any_map(in, 9)));
}

void change(Input& in, Session& session) {
  switch (in.below(8)) {
    case 1:
      return session.set_material(material(in));
    case 2:
      return session.move(in.pose());
    case 3:
      return session.set_methods(methods(in));
    case 4:
      return session.set_cast_shadow(in.chance(2));
    case 5:
      return session.set_shadow_look({in.any(), in.any3()});
    case 6:
      return session.set_environment(in.chance(2) ? nullptr : any_environment(in));
    default:
      return;
  }
}

void check_result(Session& session, const FrameResult& result, const Camera& camera) {
  require(result.image.width == camera.width && result.image.height == camera.height,
          "picture's size");
  require(std::isfinite(result.predicted_error) && result.predicted_error >= 0, "predicted error");
  for (const float v : session.object().rgba.data)
    require(std::isfinite(v) && v >= 0, "object layer");
  for (const float r : session.shadow_map().ratio.data) require(is_ratio(r), "shadow map");
  for (const float r : session.plane_gain().ratio.data)
    require(std::isfinite(r) && r >= 0, "gain of the plane");
}

}  // namespace

void fuzz(Input& in) {
  const Mesh mesh = in.chance(3) ? any_mesh(in) : tetrahedron(0.1f);
  const bool visible = in.chance(2);
  const Scene scene =
      make_scene(mesh, material(in), in.chance(3) ? in.pose() : Pose{},
                 {in.chance(2) ? 3 : 0, visible ? 8 : 0, visible ? 16 : 0, false, false});
  if (in.chance(4)) return plan_only(in, scene);
  Rig rig;
  rig.back = small_camera(in, 24, false);
  if (in.chance(2)) rig.front = small_camera(in, 24, true), rig.front_from_back = in.pose();
  SessionOptions options;
  options.methods = methods(in);
  options.map_size = in.between(1, 9);
  options.error = in.chance(4) ? in.any_double() : 0.02;
  options.cast_shadow = !in.chance(4);
  Session session(scene, rig, std::nullopt, in.chance(2) ? any_environment(in) : nullptr, nullptr,
                  make_cpu_renderer(), options);
  double time = 0;
  for (int i = in.below(6); i > 0 && !in.empty(); --i) {
    try {
      change(in, session);
      Frame frame;
      frame.time = time += in.chance(16) ? in.any_double() : 0.03;
      const bool back_there = in.chance(2), front_there = rig.front && in.chance(2);
      const OwnPicture back(in, back_there ? rig.back.width : 0, rig.back.height);
      const OwnPicture front(in, front_there ? rig.front->width : 0,
                             front_there ? rig.front->height : 0);
      frame.back = back.view(), frame.front = front.view();
      if (in.chance(4)) frame.back_exposure = in.any_double();
      if (in.chance(4)) frame.back_exposure.reset();
      if (!in.chance(8)) frame.back_from_marker = in.pose();
      if (in.chance(4)) frame.attitude = in.pose().rotation;
      if (in.chance(64)) frame.attitude = glm::dmat3(in.any_double());
      check_result(session, session.process(frame), rig.back);
    } catch (const std::invalid_argument&) {  // refused; the session goes on
    }
  }
}

}  // namespace fastibl
