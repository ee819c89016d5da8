// Two table slots in a file, for the POSIX node. A header word is on the disk before the call
// returns, and never before the image that it describes. Image words are synced only with the next
// header word, because waiting for each of thousands takes seconds.
#ifndef ARMTRUE_FIRMWARE_PORTS_POSIX_FILE_FLASH_H_
#define ARMTRUE_FIRMWARE_PORTS_POSIX_FILE_FLASH_H_

#include <string>

#include "firmware/canopen/node/parameter_store.h"
#include "firmware/storage/flash.h"

namespace armtrue::posix {

class FileFlash final : public storage::Flash {
 public:
  FileFlash(std::size_t slot_size) : slot_size_(slot_size) {}
  ~FileFlash();
  FileFlash(const FileFlash&) = delete;
  FileFlash& operator=(const FileFlash&) = delete;

  // Opens the file; if it is missing or empty, creates it with two erased slots. Empty if it
  // worked, else one sentence that names the file.
  std::string open(const std::string& path);

  std::size_t slot_size() const override { return slot_size_; }
  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override;
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override;
  bool erase(std::size_t slot) override;

 private:
  bool write_at(std::size_t position, std::span<const std::uint8_t> data);

  std::size_t slot_size_;
  int file_ = -1;
  bool has_unsynced_ = false;  // words of an image
};

// Saved parameters in a file, replaced as a whole by renaming. A change is on the disk when the
// call returns.
class FileParameters final : public canopen::ParameterStore {
 public:
  explicit FileParameters(std::string path) : path_(std::move(path)) {}

  bool load(std::span<std::uint8_t> block) override;
  bool holds_something() const override;
  bool save(std::span<const std::uint8_t> block) override;
  bool erase() override;

 private:
  std::string path_;
};

// Exclusive lock on a state folder: two nodes that write the same slots and parameters would
// overwrite each other's. The kernel releases the lock when the process ends, however it ends.
class FolderLock {
 public:
  FolderLock() = default;
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  // Empty if it worked, else one sentence that names the folder.
  std::string take(const std::string& folder);

 private:
  int file_ = -1;
};

}  // namespace armtrue::posix

#endif  // ARMTRUE_FIRMWARE_PORTS_POSIX_FILE_FLASH_H_
