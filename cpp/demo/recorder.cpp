#include "demo/recorder.h"

#include <fcntl.h>
#include <unistd.h>

#include <charconv>
#include <cstdio>
#include <string>

#include "demo/calibration.h"
#include "demo/output.h"
#include "demo/recording_tables.h"
#include "fastibl/core/check.h"
#include "fastibl/core/clock.h"

namespace fastibl::demo {
namespace {

namespace fs = std::filesystem;

constexpr double kSync = 0.5;  // seconds between calls that bring the list of pictures to the disk
constexpr std::uintmax_t kLeastFree = 200 << 20;  // bytes that are left free on the disk for others

std::string number(double value) {  // the shortest text that reads back the same
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

void append(int file, const std::string& line, const fs::path& path) {
  if (::write(file, line.data(), line.size()) != ssize_t(line.size()))
    throw std::runtime_error("could not write " + path.string());
}

int open_table(const fs::path& path, const std::string& header) {
  const int file = ::open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666);
  if (file < 0) throw std::runtime_error("could not write " + path.string());
  append(file, header, path);
  return file;
}

}  // namespace

Recorder::Recorder(const fs::path& folder, const Rig& rig, const std::optional<Board>& board)
    : folder_(folder) {
  check(!fs::exists(folder) || (fs::is_directory(folder) && fs::is_empty(folder)),
        "a recording is a new folder; ", folder.string(), " is there already");
  std::error_code error;
  fs::create_directories(folder / "back", error);
  if (!error && rig.front) fs::create_directories(folder / "front", error);
  if (error)
    throw std::runtime_error("the folder " + folder.string() +
                             " cannot be made: " + error.message());
  check_disk();
  write_rig(folder / "rig.yaml", rig);
  if (board) write_board(folder / "board.yaml", *board);
  table_ = open_table(folder / "frames.csv", "time,camera,file,exposure\n");
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() {
  try {
    close();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fastibl-demo: %s\n", error.what());
  }
}

void Recorder::close() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  for (int* file : {&table_, &attitudes_})
    if (*file >= 0) ::close(std::exchange(*file, -1));
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

void Recorder::add(std::shared_ptr<const OwnedFrame> frame, bool wait) {
  std::unique_lock lock(mutex_);
  if (wait) changed_.wait(lock, [&] { return error_ || waiting_.size() < kMostWaiting; });
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  if (waiting_.size() >= kMostWaiting) {
    ++dropped_;
    return;
  }
  waiting_.push_back(std::move(frame));
  changed_.notify_all();
}

void Recorder::check_disk() const {
  std::error_code error;
  const fs::space_info space = fs::space(folder_, error);
  if (!error && space.available < kLeastFree)
    throw std::runtime_error(std::to_string(space.available >> 20) + " MiB are free where " +
                             folder_.string() + " is, recording ends at " +
                             std::to_string(kLeastFree >> 20));
}

void Recorder::run() {
  try {
    Stopwatch since_sync;
    while (true) {
      std::shared_ptr<const OwnedFrame> frame;
      {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closing_ || !waiting_.empty(); });
        if (waiting_.empty()) return;
        frame = waiting_.front();  // counts as waiting until it is written
      }
      write(*frame);
      ++written_;
      {
        const std::lock_guard lock(mutex_);
        waiting_.pop_front();
      }
      changed_.notify_all();
      if (since_sync.seconds() < kSync) continue;
      since_sync = {};
      for (const int file : {table_, attitudes_})
        if (file >= 0) ::fsync(file);
      check_disk();
    }
  } catch (...) {
    const std::lock_guard lock(mutex_);
    error_ = std::current_exception();
    waiting_.clear();
    changed_.notify_all();
  }
}

void Recorder::write(const OwnedFrame& frame) {
  if (!frame.back.empty()) write_picture("back", frame.time, frame.back, frame.back_exposure);
  if (!frame.front.empty()) write_picture("front", frame.time, frame.front, frame.front_exposure);
  if (frame.time != time_) time_ = frame.time, untold_ = 0;
  if (!frame.attitude) {
    ++untold_;
    return;
  }
  // Frames of one time are told apart by their order: those before this one had none.
  for (; untold_ > 0; --untold_) write_attitude(frame.time, std::nullopt);
  write_attitude(frame.time, frame.attitude);
}

void Recorder::write_attitude(double time, const std::optional<glm::dmat3>& attitude) {
  const fs::path path = folder_ / "attitudes.csv";
  if (attitudes_ < 0) attitudes_ = open_table(path, std::string(kAttitudeColumns) + '\n');
  std::string line = number(time);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      line.append(",");
      if (attitude) line.append(number((*attitude)[c][r]));
    }
  append(attitudes_, line + "\n", path);
}

void Recorder::write_picture(const char* camera, double time, const Image<std::uint8_t>& picture,
                             std::optional<double> exposure) {
  int& count = counts_[camera[0] == 'f'];
  char name[32];
  std::snprintf(name, sizeof name, "%s/%05d.png", camera, count++);
  write_png(folder_ / name, picture);
  append(
      table_,
      number(time) + "," + camera + "," + name + "," + (exposure ? number(*exposure) : "") + "\n",
      folder_ / "frames.csv");
}

}  // namespace fastibl::demo
