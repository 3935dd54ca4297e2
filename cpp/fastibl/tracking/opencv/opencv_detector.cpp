#include "fastibl/tracking/opencv/opencv_detector.h"

#include <cmath>
#include <opencv2/core.hpp>

// The detector moved from the contrib module aruco to objdetect in 4.7, solvePnP from calib3d to
// geometry in 5.0.
#if CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR >= 7)
#define FASTIBL_OPENCV_HAS_ARUCO_DETECTOR
#include <opencv2/objdetect/aruco_detector.hpp>
#else
#include <opencv2/aruco.hpp>
#endif
#if CV_VERSION_MAJOR >= 5
#include <opencv2/geometry.hpp>
#else
#include <opencv2/calib3d.hpp>
#endif

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// Later versions shrink the refinement window to 0.3 of a module, which leaves the corners of small
// tags at whole pixels; a window of 3 px whatever the module did best of those tried, and is the
// same in all versions. The member's name (sic) is tested for because it came after 4.7.
constexpr int kWindow = 3;
template <typename Parameters>
void set(Parameters& parameters, const OpenCvDetectorOptions& options, const Board& board) {
  parameters.markerBorderBits = board.border_bits;
  parameters.minMarkerPerimeterRate = options.smallest_perimeter;
  const auto method =
      options.subpixel ? cv::aruco::CORNER_REFINE_SUBPIX : cv::aruco::CORNER_REFINE_NONE;
  parameters.cornerRefinementMethod = decltype(parameters.cornerRefinementMethod)(method);
  parameters.cornerRefinementWinSize = kWindow;
  if constexpr (requires { parameters.relativeCornerRefinmentWinSize; })
    parameters.relativeCornerRefinmentWinSize = 100;
}

void detect(const cv::Mat& grey, const OpenCvDetectorOptions& options, const Board& board,
            std::vector<std::vector<cv::Point2f>>& corners, std::vector<int>& ids) {
#ifdef FASTIBL_OPENCV_HAS_ARUCO_DETECTOR
  cv::aruco::DetectorParameters parameters;
  set(parameters, options, board);
  const cv::aruco::ArucoDetector detector(
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11), parameters);
  detector.detectMarkers(grey, corners, ids);
#else
  const auto parameters = cv::aruco::DetectorParameters::create();
  set(*parameters, options, board);
  cv::aruco::detectMarkers(grey, cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11),
                           corners, ids, parameters);
#endif
}

// OpenCV's camera matrix counts from the centre of the upper left pixel: half a pixel less.
std::optional<Pose> start_pose(const std::vector<DetectedTag>& tags, const Board& board,
                               const Camera& camera) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (const DetectedTag& tag : tags)
    if (const Tag* on_board = board.find(tag.id))
      for (std::size_t i = 0; i < 4; ++i) {
        points.emplace_back(on_board->corners[i].x, on_board->corners[i].y, 0);
        pixels.emplace_back(tag.corners[i].x - 0.5, tag.corners[i].y - 0.5);
      }
  if (points.empty()) return std::nullopt;
  const cv::Matx33d k(camera.fx, 0, camera.cx - 0.5, 0, camera.fy, camera.cy - 0.5, 0, 0, 1);
  cv::Vec3d rotation, translation;
  try {
    if (!cv::solvePnP(points, pixels, k, camera.distortion, rotation, translation, false,
                      cv::SOLVEPNP_SQPNP))
      return std::nullopt;
  } catch (const cv::Exception&) {  // degenerate points; the tracker has starts of its own
    return std::nullopt;
  }
  Pose pose{rotation_from_vector({rotation[0], rotation[1], rotation[2]}),
            {translation[0], translation[1], translation[2]}};
  if (!std::isfinite(pose.rotation[0][0] + glm::dot(pose.translation, pose.translation)))
    return std::nullopt;
  return pose;
}

}  // namespace

Detector opencv_detector(const OpenCvDetectorOptions& options) {
  check(options.smallest_perimeter > 0, "smallest_perimeter must be positive, got ",
        options.smallest_perimeter);
  return [options](ImageView<const std::uint8_t> grey, const Board& board, const Camera& camera) {
    check(grey.channels == 1 && !grey.empty(), "the detector needs a grey picture, got ",
          grey.channels, " channels, ", grey.width, " × ", grey.height);
    const cv::Mat image(grey.height, grey.width, CV_8UC1, const_cast<std::uint8_t*>(grey.data),
                        std::size_t(grey.stride()));  // read only
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    detect(image, options, board, corners, ids);
    Detection found;
    for (std::size_t k = 0; k < ids.size(); ++k) {
      DetectedTag tag{ids[k], {}};
      for (std::size_t i = 0; i < 4; ++i)
        tag.corners[i] = {corners[k][i].x + 0.5, corners[k][i].y + 0.5};
      found.tags.push_back(tag);
    }
    found.start = start_pose(found.tags, board, camera);
    return found;
  };
}

const char* opencv_version() { return CV_VERSION; }

}  // namespace fastibl
