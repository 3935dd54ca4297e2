// Reads and writes rig.yaml and board.yaml in the format of OpenCV's FileStorage.
#pragma once

#include <filesystem>
#include <optional>

#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"

namespace fastibl::demo {

// Throw std::invalid_argument that names the file and what is missing in it.
Rig read_rig(const std::filesystem::path& path);
std::optional<Board> read_board(const std::filesystem::path& path);  // nothing if it lists no tags
// Throw std::runtime_error.
void write_rig(const std::filesystem::path& path, const Rig& rig);
void write_board(const std::filesystem::path& path, const Board& board);

}  // namespace fastibl::demo
