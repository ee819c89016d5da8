// Files of the POSIX node across a power cut: an incomplete file is never used, and a completed
// operation has reached the disk.
#include "firmware/ports/posix/file_flash.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

// Requests to the disk, in order.
std::vector<std::string> asked;

int note_sync(int file) {
  struct stat status = {};
  fstat(file, &status);
  asked.emplace_back(S_ISDIR(status.st_mode) ? "sync directory" : "sync file");
  return 0;
}

}  // namespace

// These replace the C library's functions: the tests record requests, and do not wait for the disk.
extern "C" {
int fsync(int file) { return note_sync(file); }
int fdatasync(int file) { return note_sync(file); }
int rename(const char* from, const char* to) noexcept {
  asked.emplace_back("rename");
  return static_cast<int>(syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0));
}
int unlink(const char* path) noexcept {
  asked.emplace_back("unlink");
  return static_cast<int>(syscall(SYS_unlinkat, AT_FDCWD, path, 0));
}
}

namespace armtrue::posix {
namespace {

using Asked = std::vector<std::string>;
constexpr std::size_t kSlotSize = 16 * 1024;

class FilesTest : public testing::Test {
 protected:
  FilesTest() {
    std::string name = testing::TempDir() + "armtrue_XXXXXX";
    directory_ = mkdtemp(name.data());
    asked.clear();
  }
  ~FilesTest() override { std::filesystem::remove_all(directory_); }

  std::string directory_;
  std::array<std::uint8_t, 64> block_ = {1, 2, 3};
  std::array<std::uint8_t, 64> loaded_ = {};
};

TEST_F(FilesTest, InterruptedFirstStart_NextStartMakesTheSlots) {
  for (const std::size_t written : {std::size_t{0}, std::size_t{1}, std::size_t{4096}}) {
    SCOPED_TRACE(written);
    const std::string path = directory_ + "/slots" + std::to_string(written) + ".bin";
    const pid_t child = fork();
    if (child == 0) {
      // A write beyond `written` bytes ends the process, as a power cut would.
      const rlimit limit = {written, written};
      setrlimit(RLIMIT_FSIZE, &limit);
      FileFlash flash(kSlotSize);
      flash.open(path);
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    FileFlash flash(kSlotSize);
    EXPECT_EQ(flash.open(path), "");
    EXPECT_EQ(std::filesystem::file_size(path), 2 * kSlotSize);
    std::array<std::uint8_t, 4> bytes = {};
    flash.read(1, kSlotSize - 4, bytes);
    EXPECT_EQ(bytes, (std::array<std::uint8_t, 4>{0xFF, 0xFF, 0xFF, 0xFF}));
  }
}

TEST_F(FilesTest, NewSlots_AreSyncedBeforeTheRename) {
  FileFlash flash(kSlotSize);
  ASSERT_EQ(flash.open(directory_ + "/slots.bin"), "");
  EXPECT_EQ(asked, (Asked{"sync file", "rename", "sync directory"}));
}

TEST_F(FilesTest, ExistingSlots_AreKept_OtherSizeIsRefused) {
  const std::string path = directory_ + "/slots.bin";
  for (int start = 0; start < 2; ++start) {
    FileFlash flash(kSlotSize);
    ASSERT_EQ(flash.open(path), "");
    if (start == 0) {
      ASSERT_TRUE(flash.program(0, 64, 0x12345678));
    }
    std::array<std::uint8_t, 1> byte = {};
    flash.read(0, 64, byte);
    EXPECT_EQ(byte[0], 0x78);
  }
  EXPECT_EQ(FileFlash(kSlotSize / 2).open(path),
            path + ": is 32768 bytes, expected 16384 (two slots)");
}

TEST_F(FilesTest, SlotsInAMissingFolder_AreReported) {
  const std::string path = directory_ + "/absent/slots.bin";
  EXPECT_EQ(FileFlash(kSlotSize).open(path), path + ": No such file or directory");
}

TEST_F(FilesTest, FolderInUse_IsRefusedUntilReleased) {
  {
    FolderLock first;
    ASSERT_EQ(first.take(directory_), "");
    EXPECT_EQ(
        FolderLock().take(directory_),
        directory_ + ": in use by another armtrue_node, expected a folder of its own for each");
  }
  EXPECT_EQ(FolderLock().take(directory_), "");
}

TEST_F(FilesTest, LockInAMissingFolder_IsReported) {
  const std::string folder = directory_ + "/absent";
  EXPECT_EQ(FolderLock().take(folder), folder + "/lock: No such file or directory");
}

TEST_F(FilesTest, SavedParameters_AreSyncedBeforeTheRename) {
  FileParameters parameters(directory_ + "/parameters.bin");
  ASSERT_TRUE(parameters.save(block_));
  EXPECT_EQ(asked, (Asked{"sync file", "rename", "sync directory"}));
  ASSERT_TRUE(parameters.load(loaded_));
  EXPECT_EQ(loaded_, block_);
}

TEST_F(FilesTest, Erase_RemovesTheParametersAndSyncs) {
  FileParameters parameters(directory_ + "/parameters.bin");
  EXPECT_TRUE(parameters.erase()) << "nothing is there";
  ASSERT_TRUE(parameters.save(block_));
  asked.clear();
  ASSERT_TRUE(parameters.erase());
  EXPECT_EQ(asked, (Asked{"unlink", "sync directory"}));
  EXPECT_FALSE(parameters.holds_something());
}

TEST_F(FilesTest, SaveInAMissingFolder_Fails) {
  FileParameters parameters(directory_ + "/absent/parameters.bin");
  EXPECT_FALSE(parameters.save(block_));
}

}  // namespace
}  // namespace armtrue::posix
