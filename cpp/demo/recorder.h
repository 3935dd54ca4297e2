// Stores a recording while frames come, in a thread of its own, in the same folders as
// fastibl.Recorder.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "demo/frame_source.h"

namespace fastibl::demo {

// Every picture is written completely before frames.csv names it. No more than kMostWaiting frames
// wait, and only those are lost if the program is killed.
class Recorder {
 public:
  static constexpr std::size_t kMostWaiting = 20;  // frames, less than a second of them
  // folder: must not exist, or be empty. Throws std::invalid_argument for another one, and
  // std::runtime_error if it cannot be written or the disk is full.
  Recorder(const std::filesystem::path& folder, const Rig& rig, const std::optional<Board>& board);
  ~Recorder();  // writes the frames that wait

  // If too many frames wait already, waits itself or drops this one. Throws the error that ended
  // the recording, if there was one.
  void add(std::shared_ptr<const OwnedFrame> frame, bool wait = false);
  void close();  // also writes them; throws the error that ended the recording

  int written() const { return written_; }  // frames; call both after close()
  int dropped() const { return dropped_; }
  const std::filesystem::path& path() const { return folder_; }

 private:
  void run();
  void write(const OwnedFrame& frame);
  void write_picture(const char* camera, double time, const Image<std::uint8_t>& picture,
                     std::optional<double> exposure);
  void write_attitude(double time, const std::optional<glm::dmat3>& attitude);
  void check_disk() const;

  std::filesystem::path folder_;
  int table_ = -1, attitudes_ = -1;  // frames.csv, attitudes.csv
  int counts_[2] = {0, 0};
  double time_ = 0;  // of the last frame
  int untold_ = 0;   // frames of that time, up to the last one, without an attitude in the list
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::shared_ptr<const OwnedFrame>> waiting_;
  bool closing_ = false;
  std::exception_ptr error_;
  int written_ = 0, dropped_ = 0;
  std::thread thread_;
};

}  // namespace fastibl::demo
