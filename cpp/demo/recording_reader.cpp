#include "demo/recording_reader.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <functional>
#include <iostream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "demo/calibration.h"
#include "demo/pixels.h"
#include "demo/recording_tables.h"
#include "fastibl/core/check.h"
#include "fastibl/core/parse_number.h"

namespace fastibl::demo {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostBytes = 1 << 30;  // of a picture file
constexpr double kSameTime = 1e-3;           // seconds between a frame and its true pose

std::vector<std::string> cells(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::string> out(1);
  for (const char c : line)
    if (c == ',')
      out.emplace_back();
    else if (c != '"' && !(c == ' ' && out.back().empty()))  // names hold no commas or quotes
      out.back() += c;
  return out;
}

// A picture file, or frame `number` of a video file.
struct FileName {
  std::string file;
  std::optional<int> number;
};
std::optional<FileName> file_name(const std::string& text) {
  const std::size_t mark = text.rfind('#');
  if (mark == std::string::npos)
    return text.empty() ? std::nullopt : std::optional(FileName{text, {}});
  int number = -1;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data() + mark + 1, end, number);
  if (mark == 0 || error != std::errc{} || stop != end || number < 0) return std::nullopt;
  return FileName{text.substr(0, mark), number};
}

// Whether a file name in a recording, which others may have written, leads to a place in its
// folder.
bool stays_inside(const std::string& name) {
  const fs::path path = fs::path(name).lexically_normal();
  return path.is_relative() && !path.empty() && *path.begin() != "..";
}

// The path of a file in a recording's folder; throws if links lead out of the folder.
fs::path inside(const fs::path& folder, const std::string& name, const char* what) {
  const fs::path path = folder / name;
  if (!fs::is_regular_file(path))
    throw std::runtime_error(std::string("the ") + what + " " + path.string() + " is missing");
  const fs::path way = fs::canonical(path).lexically_relative(fs::canonical(folder));
  if (way.empty() || *way.begin() == "..")
    throw std::runtime_error(std::string("the ") + what + " " + path.string() +
                             " leads out of the recording's folder");
  return path;
}

std::vector<char> bytes_of(const fs::path& path, std::size_t most) {
  std::ifstream file(path, std::ios::binary);
  std::vector<char> bytes(std::min<std::uintmax_t>(fs::file_size(path), most));
  file.read(bytes.data(), std::streamsize(bytes.size()));
  bytes.resize(std::size_t(std::max<std::streamsize>(file.gcount(), 0)));
  return bytes;
}

double number(const std::string& text, const std::string& where) {
  const std::optional<double> value = parse_number(text);
  check(value && std::isfinite(*value), where, ": expected a finite number, got \"", text, "\"");
  return *value;
}

// The cells of a table's first line, which spreadsheets begin with a byte order mark.
std::vector<std::string> header_of(std::ifstream& file) {
  std::string line;
  std::getline(file, line);
  if (line.starts_with("\xef\xbb\xbf")) line.erase(0, 3);
  return cells(line);
}

// Calls visit(cells, where) for each line after the header, which was read before. A last line
// without a line end is left out: a crash may have cut it off.
template <typename Visit>
void for_lines(std::ifstream& file, const fs::path& path, Visit&& visit) {
  std::string line;
  for (int number_of_line = 2; std::getline(file, line); ++number_of_line) {
    const std::vector<std::string> row = cells(line);
    if (row.size() == 1 && row[0].empty()) continue;
    const std::string where = path.string() + " line " + std::to_string(number_of_line);
    if (file.eof()) {
      std::cerr << "fastibl-demo: " << where << " is cut off; it is left out\n";
      break;
    }
    visit(row, where);
  }
}

// Calls visit(time, numbers) for each line of a table with these columns; with a null pointer where
// all of its numbers are left empty.
template <typename Visit>
void for_numbers(std::ifstream& file, const fs::path& path, std::string_view columns,
                 Visit&& visit) {
  const std::vector<std::string> expected = cells(std::string(columns));
  check(header_of(file) == expected, path.string(), " must have the columns ", columns);
  for_lines(file, path, [&](const std::vector<std::string>& row, const std::string& where) {
    check(row.size() == expected.size(), where, ": expected a time and ", expected.size() - 1,
          " numbers, got ", row.size(), " values");
    if (std::all_of(row.begin() + 1, row.end(), std::mem_fn(&std::string::empty)))
      return visit(number(row[0], where), static_cast<const double*>(nullptr));
    std::vector<double> numbers;
    for (const std::string& cell : row) numbers.push_back(number(cell, where));
    visit(numbers[0], std::as_const(numbers).data() + 1);
  });
}

}  // namespace

RecordingReader::RecordingReader(const fs::path& folder, bool true_poses)
    : folder_(folder), true_poses_(true_poses) {
  check(fs::is_directory(folder), "no recording at ", folder.string(),
        ": expected a folder with rig.yaml and frames.csv");
  rig_ = read_rig(folder / "rig.yaml");
  if (fs::is_regular_file(folder / "board.yaml")) board_ = read_board(folder / "board.yaml");
  read_table(folder / "frames.csv");
  read_attitudes(folder / "attitudes.csv");
  if (true_poses) read_poses(folder / "truth" / "poses.csv");
  next_ = moments_.begin();
}

void RecordingReader::read_table(const fs::path& path) {
  std::ifstream file(path);
  check(file.good(), "the recording has no frames.csv: expected ", path.string());
  const std::vector<std::string> header = header_of(file);
  const auto column = [&](const char* name) {
    const auto found = std::find(header.begin(), header.end(), name);
    check(found != header.end(), path.string(), " has no column ", name,
          "; expected time, camera, file, exposure");
    return std::size_t(found - header.begin());
  };
  const std::size_t time = column("time"), camera = column("camera"), name = column("file"),
                    exposure = column("exposure");
  for_lines(file, path, [&](const std::vector<std::string>& row, const std::string& where) {
    check(row.size() >= header.size(), where, ": expected ", header.size(), " values, got ",
          row.size());
    Entry entry{row[name], std::nullopt};
    if (!row[exposure].empty()) entry.exposure = number(row[exposure], where);
    check(!entry.exposure || *entry.exposure > 0, where, ": the exposure must be positive, got ",
          entry.exposure.value_or(0));
    const std::optional<FileName> file_of = file_name(entry.file);
    check(file_of.has_value(), where, ": expected a picture or video#number, got \"", entry.file,
          '"');
    check(stays_inside(file_of->file), where, ": \"", entry.file,
          "\" leads out of the recording's folder");
    check(row[camera] == "back" || row[camera] == "front", where,
          ": camera must be back or front, got \"", row[camera], "\"");
    check(row[camera] == "back" || rig_.front, path.string(),
          " lists front pictures, but rig.yaml has no front camera");
    const double at = number(row[time], where);
    Entry Moment::*const which = row[camera] == "back" ? &Moment::back : &Moment::front;
    auto last = moments_.upper_bound(at);
    const bool known = last != moments_.begin() && (--last)->first == at;
    if (!known || !(last->second.*which).file.empty())  // another picture with the same time
      last = moments_.emplace(at, Moment{});
    last->second.*which = entry;
  });
  check(!moments_.empty(), path.string(), " lists no pictures");
}

void RecordingReader::read_poses(const fs::path& path) {
  std::ifstream file(path);
  check(file.good(), "--poses truth needs true poses: expected ", path.string());
  for_numbers(file, path, kPoseColumns, [&](double time, const double* m) {
    check(m != nullptr, path.string(), ": expected a pose at ", time, " s");
    glm::dmat4 matrix(1.0);
    for (int k = 0; k < 12; ++k) matrix[k % 4][k / 4] = m[k];
    poses_[time] = Pose::from_matrix(matrix);
  });
}

// The file exists if there was a gyroscope.
void RecordingReader::read_attitudes(const fs::path& path) {
  std::ifstream file(path);
  if (!file.good()) return;
  for_numbers(file, path, kAttitudeColumns, [&](double time, const double* m) {
    std::optional<glm::dmat3> rotation;
    if (m) {
      rotation.emplace();
      for (int k = 0; k < 9; ++k) (*rotation)[k % 3][k / 3] = m[k];
      check(is_rotation(*rotation, kAttitude), path.string(), ": the attitude at ", time,
            " s must be a rotation");
    }
    attitudes_.emplace(time, rotation);  // after others with the same time
  });
}

std::optional<OwnedFrame> RecordingReader::next() {
  if (next_ == moments_.end()) return std::nullopt;
  const auto& [time, moment] = *next_;
  OwnedFrame frame;
  frame.time = time;
  frame.back_exposure = moment.back.exposure, frame.front_exposure = moment.front.exposure;
  // Frames with the same time each have an attitude of their own, in the same order.
  const auto first = moments_.lower_bound(time);
  auto told = attitudes_.lower_bound(time);
  for (auto of = first; of != next_ && told != attitudes_.end(); ++of) ++told;
  if (told != attitudes_.end() && told->first == time) frame.attitude = told->second;
  if (true_poses_) {
    const auto pose = poses_.lower_bound(time - kSameTime);
    check(pose != poses_.end() && pose->first <= time + kSameTime,
          "this recording holds no true pose at ", time, " s");
    frame.back_from_marker = pose->second;
  }
  try {
    if (!moment.back.file.empty()) frame.back = read(moment.back.file);
    if (!moment.front.file.empty()) frame.front = read(moment.front.file);
  } catch (const std::exception& error) {  // the frames read so far are kept
    std::cerr << "fastibl-demo: " << error.what() << "; " << std::distance(moments_.cbegin(), next_)
              << " of " << moments_.size() << " frames were read\n";
    next_ = moments_.end();
    return std::nullopt;
  }
  ++next_;
  return frame;
}

Image<std::uint8_t> RecordingReader::read(const std::string& file) {
  const FileName name = *file_name(file);
  if (name.number) return rgb_from(read_video(name.file, *name.number));
  const fs::path path = inside(folder_, file, "picture");
  const std::vector<char> data = bytes_of(path, kMostBytes);
  const std::string_view content(data.data(), data.size());
  // Checked here, because the decoder fills in what is missing in a JPEG that was cut off.
  const bool cut = content.starts_with("\xff\xd8") && content.rfind("\xff\xd9") == content.npos;
  // Reads the picture as the sensor took it, however the camera was held.
  constexpr int kAsTaken = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;
  const cv::Mat picture = cut || data.empty() ? cv::Mat() : cv::imdecode(data, kAsTaken);
  if (picture.empty())
    throw std::runtime_error("the picture " + path.string() + " cannot be read; it may be cut off");
  return rgb_from(picture);
}

// Reads frame by frame, because seeking is not exact in every container.
cv::Mat RecordingReader::read_video(const std::string& name, int number) {
  const fs::path path = inside(folder_, name, "video");
  Video& video = videos_[name];
  if (!video.capture.isOpened() || number < video.following) {
    // The content tells the kind of file: a playlist under that name would make FFmpeg read the
    // files that it lists.
    const std::vector<char> head = bytes_of(path, 12);
    const std::string_view kind(head.data(), head.size());
    if (!kind.starts_with("\x1a\x45\xdf\xa3") && !kind.starts_with("RIFF") &&
        kind.substr(std::min<std::size_t>(4, kind.size()), 4) != "ftyp")
      throw std::runtime_error("the video " + path.string() +
                               " cannot be read: it is no Matroska, AVI or MP4 file");
    video = {cv::VideoCapture(path.string()), 0};
    video.capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
    if (!video.capture.isOpened())
      throw std::runtime_error("the video " + path.string() + " cannot be read");
  }
  cv::Mat picture;
  for (; video.following <= number; ++video.following)
    if (!video.capture.read(picture))
      throw std::runtime_error("the video " + path.string() + " ends after " +
                               std::to_string(video.following) + " frames, frame " +
                               std::to_string(number) + " is missing");
  return picture;
}

double RecordingReader::fps() const {
  // Counts back pictures only: front pictures may have times of their own.
  int count = 0;
  double first = 0, last = 0;
  for (const auto& [time, moment] : moments_) {
    if (moment.back.file.empty()) continue;
    if (count++ == 0) first = time;
    last = time;
  }
  return last > first ? (count - 1) / (last - first) : 30;
}

}  // namespace fastibl::demo
