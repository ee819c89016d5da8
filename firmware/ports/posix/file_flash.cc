#include "firmware/ports/posix/file_flash.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <vector>

#include "firmware/storage/slot_format.h"

namespace armtrue::posix {
namespace {

// A new or removed file name is on the disk only after its directory has been synced.
bool sync_directory_of(const std::string& path) {
  const std::string directory = std::filesystem::path(path).parent_path().string();
  const int file =
      open(directory.empty() ? "." : directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) return false;
  const bool is_synced = fsync(file) == 0;
  close(file);
  return is_synced;
}

// Writes a temporary file and renames it, so that a file of this name is always complete. False
// with errno on failure.
bool replace_file(const std::string& path, std::span<const std::uint8_t> content) {
  const std::string part = path + ".part";
  const int file = open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) return false;
  std::span<const std::uint8_t> left = content;
  for (ssize_t written = 1; written > 0 && !left.empty();) {
    written = write(file, left.data(), left.size());
    if (written > 0) left = left.subspan(static_cast<std::size_t>(written));
  }
  const bool is_whole = left.empty() && fsync(file) == 0;
  const int why = errno;
  close(file);
  errno = why;
  return is_whole && std::rename(part.c_str(), path.c_str()) == 0 && sync_directory_of(path);
}

}  // namespace

FileFlash::~FileFlash() {
  if (file_ >= 0) close(file_);
}

std::string FileFlash::open(const std::string& path) {
  const std::size_t whole = storage::kSlots * slot_size_;
  struct stat status = {};
  const bool is_there = stat(path.c_str(), &status) == 0 && status.st_size != 0;
  const std::vector<std::uint8_t> erased(is_there ? 0 : whole, 0xFF);
  if (!is_there && !replace_file(path, erased)) return path + ": " + std::strerror(errno);
  file_ = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (file_ < 0) return path + ": " + std::strerror(errno);
  fstat(file_, &status);
  if (static_cast<std::size_t>(status.st_size) != whole) {
    return path + ": is " + std::to_string(status.st_size) + " bytes, expected " +
           std::to_string(whole) + " (two slots)";
  }
  return "";
}

void FileFlash::read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const {
  const auto position = static_cast<off_t>(slot * slot_size_ + offset);
  if (pread(file_, data.data(), data.size(), position) != static_cast<ssize_t>(data.size())) {
    std::fill(data.begin(), data.end(), std::uint8_t{0});  // zeros are no valid slot
  }
}

bool FileFlash::write_at(std::size_t position, std::span<const std::uint8_t> data) {
  const ssize_t written = pwrite(file_, data.data(), data.size(), static_cast<off_t>(position));
  return written == static_cast<ssize_t>(data.size());
}

bool FileFlash::program(std::size_t slot, std::size_t offset, std::uint32_t word) {
  std::array<std::uint8_t, 4> bytes = {};
  read(slot, offset, bytes);
  // Flash only clears bits.
  word &= canopen::load_le<std::uint32_t>(bytes.data());
  canopen::store_le(bytes.data(), word);
  const bool is_header = offset < storage::kHeaderBytes;
  if (is_header && has_unsynced_ && fdatasync(file_) != 0) return false;
  has_unsynced_ = !is_header;
  return write_at(slot * slot_size_ + offset, bytes) && (!is_header || fdatasync(file_) == 0);
}

bool FileFlash::erase(std::size_t slot) {
  std::array<std::uint8_t, 4096> blank;
  blank.fill(0xFF);
  for (std::size_t at = 0; at < slot_size_; at += blank.size()) {
    const std::size_t size = std::min(blank.size(), slot_size_ - at);
    if (!write_at(slot * slot_size_ + at, std::span(blank).first(size))) return false;
  }
  return fdatasync(file_) == 0;
}

bool FileParameters::load(std::span<std::uint8_t> block) {
  std::ifstream file(path_, std::ios::binary);
  file.read(reinterpret_cast<char*>(block.data()), static_cast<std::streamsize>(block.size()));
  return file.gcount() == static_cast<std::streamsize>(block.size());
}

bool FileParameters::holds_something() const { return access(path_.c_str(), F_OK) == 0; }

bool FileParameters::save(std::span<const std::uint8_t> block) {
  return replace_file(path_, block);
}

bool FileParameters::erase() {
  return (unlink(path_.c_str()) == 0 || errno == ENOENT) && sync_directory_of(path_);
}

FolderLock::~FolderLock() {
  if (file_ >= 0) close(file_);
}

std::string FolderLock::take(const std::string& folder) {
  // A separate file, opened for writing, because network file systems cannot lock a folder. It is
  // never removed: a process about to lock it would then lock a file that no other process finds.
  file_ = open((folder + "/lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (file_ >= 0 && flock(file_, LOCK_EX | LOCK_NB) == 0) return "";
  if (file_ >= 0 && errno == EWOULDBLOCK) {
    return folder + ": in use by another armtrue_node, expected a folder of its own for each";
  }
  return folder + "/lock: " + std::strerror(errno);
}

}  // namespace armtrue::posix
