// Tags as a detector may return them, and pictures of anything, tracked from any starting pose.
#include <stdexcept>

#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/rotation_tracker.h"
#include "pictures.h"

namespace fastibl {
namespace {

constexpr int kRows = 2, kColumns = 2;
constexpr double kTag = 0.04, kSpace = 0.01;

void check_pose(const Pose& pose) {
  Pose::from_matrix(pose.matrix());  // rigid and finite
}

void check_tracked(const std::optional<Tracked>& tracked) {
  if (!tracked) return;
  try {
    check_pose(tracked->camera_from_marker);
    if (tracked->last_row) check_pose(*tracked->last_row);
  } catch (const std::invalid_argument& error) {
    require(false, error.what());
  }
  require(std::isfinite(tracked->residual_px) && tracked->residual_px >= 0, "residual");
  for (const double v : tracked->covariance) require(std::isfinite(v), "covariance");
  for (int i = 0; i < 6; ++i) require(tracked->covariance[std::size_t(7 * i)] >= 0, "variance");
}

Camera camera_of(Input& in) {
  Camera camera;
  camera.width = camera.height = 48;
  camera.fx = camera.fy = 48, camera.cx = camera.cy = 24;
  if (in.chance(4)) return small_camera(in, 48, false);
  if (in.chance(4)) camera.distortion = {0.3 * in.near(), 0.3 * in.near(), 0, 0};
  if (in.chance(4)) camera.readout = 0.03 * in.share();
  return camera;
}

// A pose in front of the camera, more or less facing it.
Pose facing(Input& in) {
  const glm::dmat3 upright(1, 0, 0, 0, -1, 0, 0, 0, -1);
  return {rotation_from_vector(0.6 * glm::dvec3(in.near3())) * upright,
          {0.05 * in.near(), 0.05 * in.near(), 0.02 + 0.5 * in.share()}};
}

std::vector<DetectedTag> tags_of(Input& in, const Board& board, const Camera& camera,
                                 const Pose& pose) {
  std::vector<DetectedTag> tags;
  for (int n = in.below(6), i = 0; i < n; ++i) {
    DetectedTag tag;
    const bool known = in.chance(2);
    tag.id = known ? i % (kRows * kColumns) : in.below(600) - 5;
    const Tag* on_board = board.find(tag.id);
    for (int c = 0; c < 4; ++c) {
      const auto pixel =
          on_board ? camera.project(pose * glm::dvec3(on_board->corners[std::size_t(c)], 0))
                   : std::nullopt;
      tag.corners[std::size_t(c)] = pixel && !in.chance(16)
                                        ? *pixel + 0.2 * glm::dvec2(in.near(), in.near())
                                        : glm::dvec2(in.any_double(), in.any_double());
    }
    tags.push_back(tag);
  }
  return tags;
}

// Roughly the board as the camera sees it: black tags on white, with noise from the input's bytes.
Image<std::uint8_t> picture_of(Input& in, const Board& board, const Camera& camera,
                               const Pose& pose) {
  Image<std::uint8_t> grey(camera.width, camera.height, 1,
                           in.chance(4) ? in.byte() : std::uint8_t(200));
  const Pose back = pose.inverse();
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const auto ray = camera.unproject({x + 0.5, y + 0.5});
      if (!ray) continue;
      const glm::dvec3 d = back.rotation * *ray;
      const glm::dvec3 p = back.translation - d * (back.translation.z / d.z);
      for (const Tag& tag : board.tags) {
        const glm::dvec2 at = (glm::dvec2(p) - tag.corners[3]) / kTag;
        if (at.x > 0 && at.y > 0 && at.x < 1 && at.y < 1) {
          const bool rim = std::min({at.x, at.y, 1 - at.x, 1 - at.y}) < 0.125;
          *grey.pixel(x, y) =
              rim || (int(at.x * 8) * 7 + int(at.y * 8) * 3 + tag.id) % 2 ? 20 : 220;
        }
      }
    }
  for (int i = in.below(16); i > 0; --i)
    grey.data[std::size_t(in.below(int(grey.data.size())))] = in.byte();
  return grey;
}

void follow(Input& in, const Board& board, const Camera& camera) {
  EdgeTrackingOptions options;
  options.smoothing = in.chance(4) ? in.share() : 0;
  EdgeTracker tracker(board, camera, options);
  double time = 0;
  for (int i = in.below(4); i > 0; --i) {
    const Pose pose = facing(in);
    const Image<std::uint8_t> grey = picture_of(in, board, camera, pose);
    std::vector<std::uint8_t> rgb;
    for (const std::uint8_t v : grey.data) rgb.insert(rgb.end(), 3, v);
    const Picture picture{rgb.data(), PixelType::uint8, camera.width, camera.height,
                          3 * camera.width};
    const Detector detector = [&](ImageView<const std::uint8_t>, const Board&, const Camera&) {
      Detection found{tags_of(in, board, camera, pose), {}};
      if (in.chance(4)) found.start = in.chance(2) ? in.pose() : pose;
      return found;
    };
    time += in.chance(8) ? std::fabs(in.near()) : 0.03;
    MotionHint hint;
    if (in.chance(4)) hint.turn = in.pose().rotation;
    if (in.chance(4)) hint.gravity = glm::dvec3(in.any3());
    check_tracked(
        tracker.track(picture, in.chance(4) ? std::nullopt : std::optional(time), detector, hint));
  }
}

void turn(Input& in) {
  Rig rig;
  rig.back = small_camera(in, 48, false);
  RotationTracker tracker(rig);
  const Environment environment = environment_from(any_map(in, 32));
  double time = 0;
  for (int i = 0; i < 3; ++i) {
    const OwnPicture picture(in, rig.back.width, rig.back.height);
    RigPictures pictures;
    pictures.back = picture.view();
    if (in.chance(4)) pictures.back_exposure = std::fabs(in.near()) + 1e-3;
    if (i == 0) tracker.start(in.pose(), time, pictures);
    time += 0.05;
    const auto turned = tracker.track(environment, pictures, time);
    if (!turned) continue;
    check_pose(turned->back_from_marker);
    for (const double v : turned->covariance) require(std::isfinite(v), "covariance of a turn");
    for (const double gain : {turned->back_gain, turned->front_gain})
      require(gain > 0 && std::isfinite(gain), "gain");
  }
}

}  // namespace

void fuzz(Input& in) {
  const Board board = Board::grid(kRows, kColumns, kTag, kSpace);
  if (in.chance(4)) return turn(in);
  const Camera camera = camera_of(in);
  if (in.chance(3)) return follow(in, board, camera);
  const Pose pose = facing(in);
  Detection detection{tags_of(in, board, camera, pose), {}};
  if (in.chance(4)) detection.start = in.pose();
  TrackingOptions options;
  options.method = in.chance(2) ? TrackingMethod::frame_marker : TrackingMethod::board;
  const Image<std::uint8_t> grey = picture_of(in, board, camera, pose);
  check_tracked(track(detection, board, camera, options));
  check_tracked(track(detection, grey.view(), board, camera, options));
  check_tracked(
      EdgeModel(board, camera).track(grey.view(), in.chance(4) ? in.pose() : pose, {}, {}));
}

}  // namespace fastibl
