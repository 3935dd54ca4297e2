// Reads the frames of a recording: a folder with rig.yaml, board.yaml, frames.csv, and pictures or
// videos.
#pragma once

#include <filesystem>
#include <map>
#include <opencv2/videoio.hpp>
#include <string>

#include "demo/frame_source.h"

namespace fastibl::demo {

class RecordingReader final : public FrameSource {
 public:
  // true_poses: whether frames get the poses of truth/poses.csv. Throws std::invalid_argument that
  // names what is missing or wrong.
  RecordingReader(const std::filesystem::path& folder, bool true_poses);

  const Rig& rig() const override { return rig_; }
  std::optional<Board> board() const override { return board_; }
  std::optional<OwnedFrame> next() override;
  bool ended() const override { return next_ == moments_.end(); }
  double fps() const override;
  bool live() const override { return false; }

 private:
  struct Entry {
    std::string file;                    // a picture's name, or video#frame; empty: none
    std::optional<double> exposure = 1;  // nothing if the camera did not tell it
  };
  struct Moment {
    Entry back, front;
  };
  struct Video {
    cv::VideoCapture capture;
    int following = 0;
  };
  void read_table(const std::filesystem::path& path);
  void read_poses(const std::filesystem::path& path);
  void read_attitudes(const std::filesystem::path& path);
  Image<std::uint8_t> read(const std::string& file);
  cv::Mat read_video(const std::string& name, int number);

  std::filesystem::path folder_;
  Rig rig_;
  std::optional<Board> board_;
  std::multimap<double, Moment> moments_;  // by time
  std::multimap<double, Moment>::const_iterator next_;
  bool true_poses_;
  std::map<double, Pose> poses_;
  std::multimap<double, std::optional<glm::dmat3>> attitudes_;
  std::map<std::string, Video> videos_;
};

}  // namespace fastibl::demo
