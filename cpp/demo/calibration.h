// rig.yaml and board.yaml, as OpenCV's FileStorage has them.
#pragma once

#include <filesystem>
#include <optional>

#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"

namespace fastibl::demo {

// Throws std::invalid_argument that names the file and what it lacks.
Rig read_rig(const std::filesystem::path& path);
std::optional<Board> read_board(const std::filesystem::path& path);  // nothing: it lists no tags
// Throw std::runtime_error.
void write_rig(const std::filesystem::path& path, const Rig& rig);
void write_board(const std::filesystem::path& path, const Board& board);

}  // namespace fastibl::demo
