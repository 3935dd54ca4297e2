#include "demo/calibration.h"

#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "demo/calibration_text.h"
#include "demo/output.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMostValues = 1 << 14;  // in a matrix

cv::FileStorage open(const fs::path& path) {
  const std::string text = calibration_text(path);
  try {
    cv::FileStorage storage(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    check(storage.isOpened(), path.string(), " cannot be opened");
    return storage;
  } catch (const cv::Exception& error) {
    throw std::invalid_argument(path.string() +
                                " is not a file that OpenCV's FileStorage reads: " + error.what());
  }
}

double number(const cv::FileNode& node, const char* name, const fs::path& path) {
  const cv::FileNode item = node[name];
  check(item.isInt() || item.isReal(), path.string(), " has no number ", name);
  return item.real();
}

// The elements of a matrix, row by row; empty if there is none. They are read one by one, because
// FileNode::mat() writes beyond its memory when the file is broken.
std::vector<double> numbers(const cv::FileNode& parent, const char* name, const fs::path& path) {
  const cv::FileNode node = parent[name];
  if (node.empty()) return {};
  check(node.isMap(), path.string(), ": ", name, " must be a matrix");
  const cv::FileNode rows = node["rows"], columns = node["cols"], data = node["data"];
  check(rows.isInt() && columns.isInt(), path.string(), ": ", name,
        " must be a matrix with rows and cols");
  const std::int64_t height = int(rows), width = int(columns), count = height * width;
  check(height > 0 && width > 0 && count <= kMostValues && data.isSeq() &&
            std::int64_t(data.size()) == count,
        path.string(), ": ", name, " must be a matrix of ", height, " × ", width, " values");
  std::vector<double> values;
  for (const cv::FileNode& value : data) {
    check(value.isInt() || value.isReal(), path.string(), ": ", name, " must hold numbers");
    values.push_back(value.real());
  }
  return values;
}

int whole(const cv::FileNode& node, const char* name, const fs::path& path) {
  const double value = number(node, name, path);
  check(value == std::floor(value) && std::abs(value) < 1e9, path.string(), ": ", name,
        " must be a whole number, got ", value);
  return int(value);
}

// Turns an error of OpenCV's own into one that names the file.
template <typename Read>
auto told(const fs::path& path, Read&& read) {
  try {
    return read();
  } catch (const cv::Exception& error) {
    throw std::invalid_argument(path.string() + " is damaged: " + error.err);
  }
}

Response read_response(const cv::FileNode& camera, const fs::path& path) {
  const cv::FileNode node = camera["response"];
  if (node.empty()) return Response::srgb();
  if (node.isString()) {
    check(node.string() == "srgb", path.string(), ": response must be \"srgb\" or a curve, got \"",
          node.string(), "\"");
    return Response::srgb();
  }
  const std::vector<double> curve = numbers(camera, "response", path);
  return Response::from_curve({curve.begin(), curve.end()});
}

Camera read_camera(const cv::FileNode& node, const char* name, const fs::path& path) {
  check(node.isMap(), path.string(), ": ", name, " must be a map");
  const std::vector<double> k = numbers(node, "camera_matrix", path);
  check(k.size() == 9, path.string(), " has no 3 × 3 camera_matrix of the ", name, " camera");
  check(k[1] == 0, path.string(), ": the ", name, " camera has a skew of ", k[1],
        "; expected a camera_matrix without");
  Camera camera;
  camera.width = whole(node, "width", path);
  camera.height = whole(node, "height", path);
  camera.fx = k[0], camera.fy = k[4];
  camera.cx = k[2] + 0.5, camera.cy = k[5] + 0.5;  // OpenCV counts from the first pixel's centre
  camera.distortion = numbers(node, "distortion", path);
  camera.vignetting = numbers(node, "vignetting", path);
  camera.response = read_response(node, path);
  if (!node["readout"].empty()) camera.readout = number(node, "readout", path);
  if (!node["gain"].empty()) camera.gain = number(node, "gain", path);
  if (!node["field_of_view"].empty()) camera.field_of_view = number(node, "field_of_view", path);
  if (!node["model"].empty()) {
    check(node["model"].isString(), path.string(), ": model must be a name");
    camera.model = camera_model(std::string(node["model"]));
  }
  camera.validate();
  return camera;
}

Pose pose_of(const std::vector<double>& m, const fs::path& path) {
  check(m.size() == 16, path.string(), " has a front camera, but no 4 × 4 front_from_back");
  glm::dmat4 matrix;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      matrix[column][row] = m[std::size_t(4 * row + column)];
  return Pose::from_matrix(matrix);
}

}  // namespace

Rig read_rig(const fs::path& path) {
  return told(path, [&] {
    const cv::FileStorage storage = open(path);
    const cv::FileNode root = storage.root();
    check(!root["back"].empty(), path.string(), " has no back camera");
    Rig rig;
    rig.back = read_camera(root["back"], "back", path);
    if (root["front"].empty()) return rig;
    rig.front = read_camera(root["front"], "front", path);
    rig.front_from_back = pose_of(numbers(root, "front_from_back", path), path);
    return rig;
  });
}

namespace {

std::optional<Board> board_of(const fs::path& path) {
  const cv::FileStorage storage = open(path);
  const cv::FileNode root = storage.root();
  const std::vector<double> ids = numbers(root, "ids", path),
                            corners = numbers(root, "corners", path);
  if (ids.empty()) return std::nullopt;
  check(corners.size() == 8 * ids.size(), path.string(),
        ": expected four corners (x, y) for each of ", ids.size(), " tags, got ", corners.size(),
        " numbers");
  Board board;
  board.border_bits = whole(root, "border_bits", path);
  board.width = number(root, "width", path), board.height = number(root, "height", path);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    Tag tag{int(ids[k]), {}};
    for (std::size_t i = 0; i < 4; ++i)
      tag.corners[i] = {corners[8 * k + 2 * i], corners[8 * k + 2 * i + 1]};
    board.tags.push_back(tag);
  }
  board.validate();
  return board;
}

}  // namespace

std::optional<Board> read_board(const fs::path& path) {
  return told(path, [&] { return board_of(path); });
}

namespace {

// OpenCV writes to a text, which is then written to a file: its own file writer does not notice a
// full disk.
cv::FileStorage begin() {
  constexpr int kYaml =
      cv::FileStorage::WRITE | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML;
  return cv::FileStorage(".yaml", kYaml);
}
void finish(cv::FileStorage& storage, const fs::path& path) {
  const std::string text = storage.releaseAndGetString();
  write_file(path, text.data(), text.size());
}

cv::Mat row_of(const std::vector<double>& values) { return cv::Mat(values, true).reshape(1, 1); }

void write_camera(cv::FileStorage& storage, const char* name, const Camera& camera) {
  storage.startWriteStruct(name, cv::FileNode::MAP);
  storage.write("width", camera.width);
  storage.write("height", camera.height);
  if (camera.model != CameraModel::perspective)
    storage.write("model", std::string(fastibl::name(camera.model)));
  if (camera.field_of_view != 360) storage.write("field_of_view", camera.field_of_view);
  const cv::Matx33d matrix(camera.fx, 0, camera.cx - 0.5, 0, camera.fy, camera.cy - 0.5, 0, 0, 1);
  storage.write("camera_matrix", cv::Mat(matrix));
  if (!camera.distortion.empty()) storage.write("distortion", row_of(camera.distortion));
  if (!camera.vignetting.empty()) storage.write("vignetting", row_of(camera.vignetting));
  storage.write("gain", camera.gain);
  if (camera.readout > 0) storage.write("readout", camera.readout);
  if (camera.response.curve.empty())
    storage.write("response", "srgb");
  else
    storage.write("response", cv::Mat(camera.response.curve, true).reshape(1, 1));
  storage.endWriteStruct();
}

}  // namespace

void write_rig(const fs::path& path, const Rig& rig) {
  cv::FileStorage storage = begin();
  write_camera(storage, "back", rig.back);
  if (rig.front) {
    write_camera(storage, "front", *rig.front);
    cv::Matx44d matrix;
    const glm::dmat4 pose = rig.front_from_back.matrix();
    for (int k = 0; k < 16; ++k) matrix(k / 4, k % 4) = pose[k % 4][k / 4];
    storage.write("front_from_back", cv::Mat(matrix));
  }
  finish(storage, path);
}

void write_board(const fs::path& path, const Board& board) {
  cv::FileStorage storage = begin();
  std::vector<int> ids;
  std::vector<double> corners;
  for (const Tag& tag : board.tags) {
    ids.push_back(tag.id);
    for (const glm::dvec2& corner : tag.corners)
      corners.push_back(corner.x), corners.push_back(corner.y);
  }
  storage.write("ids", cv::Mat(ids, true).reshape(1, 1));
  storage.write("corners", cv::Mat(corners, true).reshape(1, int(4 * ids.size())));
  storage.write("border_bits", board.border_bits);
  storage.write("width", board.width);
  storage.write("height", board.height);
  finish(storage, path);
}

}  // namespace fastibl::demo
