// Cuts power, or lets an operation fail, at every flash operation of the programs and histories
// below. After each restart the active table must be complete, one that the interrupted program
// allowed, and the same at every later restart.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <set>
#include <vector>

#include "firmware/storage/simulated_flash.h"
#include "firmware/storage/slot_store.h"
#include "firmware/storage/test_tables.h"

namespace armtrue::storage {
namespace {

enum class Step : std::uint8_t { kCommit, kActivate, kConfirm, kRevert };

using Script = std::vector<Step>;

// Identifies the active image: 0 stands for none (pass-through), n for make_image(n).
using Name = std::uint8_t;
constexpr Name kMixed = 255;

class Device {
 public:
  Device(std::size_t image_size, std::uint32_t seed)
      : image_size_(image_size),
        flash_(std::make_unique<SimulatedFlash>(kHeaderBytes + (image_size + 3) / 4 * 4, seed)),
        buffer_(image_size),
        allowed_{0} {}

  SimulatedFlash& flash() { return *flash_; }

  // A power-on that runs `script` for the image `name`. Returns false if power was cut meanwhile.
  // Afterwards `allowed_` holds the images that may be active at the next start.
  bool run(const Script& script, Name name) {
    try {
      SlotStore store(*flash_, verifier_);
      Name active = identify(store.start(buffer_));
      EXPECT_TRUE(allowed_.contains(active)) << "active is " << int{active};
      allowed_ = {active};
      const Name confirmed = active;
      for (const Step step : script) {
        if (!run(store, step, name, confirmed)) break;
      }
      return true;
    } catch (const PowerCut&) {
      return false;
    }
  }

  // Restarts undisturbed: the active table is allowed, and it does not change any more.
  void expect_settled() {
    flash_->run_undisturbed();
    run({}, 0);
    run({}, 0);
    run({}, 0);
    EXPECT_EQ(allowed_.size(), 1u);
  }

  // The next upload succeeds, whatever happened before.
  void expect_usable(Name name) {
    flash_->run_undisturbed();
    run({Step::kCommit, Step::kActivate, Step::kConfirm}, name);
    EXPECT_EQ(allowed_, std::set<Name>{name});
    run({}, 0);
  }

 private:
  Name identify(std::span<const std::uint8_t> image) const {
    if (image.empty()) return 0;
    const Image expected = make_image(image[1], image_size_);
    return std::ranges::equal(image, expected) ? image[1] : kMixed;
  }

  bool run(SlotStore& store, Step step, Name name, Name confirmed) {
    std::span<const std::uint8_t> image;
    switch (step) {
      case Step::kCommit:
        return store.commit(make_image(name, image_size_)) == StoreResult::kDone;
      case Step::kActivate:
        if (store.activate(buffer_, image) != StoreResult::kDone) return false;
        EXPECT_EQ(identify(image), name);
        return true;
      case Step::kConfirm:
        allowed_ = {confirmed, name};
        if (store.confirm() != StoreResult::kDone) return false;
        allowed_ = {name};
        return true;
      case Step::kRevert:
        if (store.revert() != StoreResult::kDone) return false;
        EXPECT_EQ(identify(store.load_active(buffer_)), confirmed);
        return true;
    }
    return false;
  }

  std::size_t image_size_;
  std::unique_ptr<SimulatedFlash> flash_;
  TestVerifier verifier_;
  Image buffer_;
  std::set<Name> allowed_;
};

const Script kInstall = {Step::kCommit, Step::kActivate, Step::kConfirm};

// What the flash holds before the program that is disturbed, oldest first.
struct History {
  const char* name;
  std::vector<Script> scripts;
};

const std::vector<History> kHistories = {
    {"blank", {}},
    {"one table", {kInstall}},
    {"two tables", {kInstall, kInstall}},
    {"a table and a rejected one", {kInstall, {Step::kCommit, Step::kActivate, Step::kRevert}}},
    {"a table and a trial that nobody confirmed", {kInstall, {Step::kCommit, Step::kActivate}}},
    {"a table and one that waits", {kInstall, {Step::kCommit}}},
};

const std::vector<Script> kPrograms = {
    kInstall,
    {Step::kCommit, Step::kActivate, Step::kRevert},
    {Step::kCommit, Step::kRevert},
    {Step::kCommit, Step::kCommit, Step::kActivate, Step::kConfirm},
};

constexpr Name kDisturbed = 10;  // image of the program that is disturbed
constexpr Name kSecond = 20;     // image of the program after it
constexpr Name kLast = 30;

Device prepared(const History& history, std::size_t image_size, std::uint32_t seed) {
  Device device(image_size, seed);
  Name name = 1;
  for (const Script& script : history.scripts) device.run(script, name++);
  return device;
}

std::size_t operations_of(const History& history, const Script& program, std::size_t image_size) {
  Device device = prepared(history, image_size, 1);
  device.flash().run_undisturbed();
  device.run(program, kDisturbed);
  return device.flash().operations();
}

void report(const char* what, std::size_t cases) {
  std::printf("[ COUNT    ] %s: %zu\n", what, cases);
  testing::Test::RecordProperty(what, static_cast<int>(cases));
}

TEST(PowerCut, AtEveryOperationOfEveryProgram) {
  std::size_t cases = 0;
  for (const History& history : kHistories) {
    for (const Script& program : kPrograms) {
      for (const std::size_t image_size : {20u, 400u}) {
        const std::size_t operations = operations_of(history, program, image_size);
        for (std::size_t at = 0; at < operations; ++at) {
          for (const CutKind kind : kAllCutKinds) {
            for (std::uint32_t seed = 1; seed <= 3; ++seed) {
              Device device =
                  prepared(history, image_size, seed + 10 * static_cast<std::uint32_t>(cases));
              device.flash().cut_at(at, kind);
              EXPECT_FALSE(device.run(program, kDisturbed));
              device.expect_settled();
              device.expect_usable(kLast);
              ++cases;
              ASSERT_FALSE(testing::Test::HasFailure())
                  << history.name << ", image of " << image_size << ", operation " << at
                  << ", kind " << int(kind) << ", seed " << seed;
            }
          }
        }
      }
    }
  }
  report("single power cuts", cases);
  EXPECT_GT(cases, 10000u);
}

TEST(PowerCut, AtEveryOperationOfTheLargestTable) {
  constexpr std::size_t kLargest = 16 * 1024;
  const History& history = kHistories[1];
  const std::size_t operations = operations_of(history, kInstall, kLargest);
  ASSERT_GT(operations, kLargest / 4);
  const Device before = prepared(history, kLargest, 7);
  std::size_t cases = 0;
  for (std::size_t at = 0; at < operations; ++at) {
    // One kind of cut per operation, in turn. The small images above are tested with every
    // combination.
    Device device = prepared(history, kLargest, static_cast<std::uint32_t>(at));
    device.flash().cut_at(at, kAllCutKinds[at % kAllCutKinds.size()]);
    EXPECT_FALSE(device.run(kInstall, kDisturbed));
    device.expect_settled();
    ++cases;
    ASSERT_FALSE(testing::Test::HasFailure()) << "operation " << at;
  }
  report("power cuts of a 16 KiB table", cases);
}

TEST(PowerCut, AtEveryPairOfOperations) {
  constexpr std::size_t kShort = 12;
  std::size_t cases = 0;
  for (const History& history : kHistories) {
    const std::size_t first_operations = operations_of(history, kInstall, kShort);
    for (std::size_t first = 0; first < first_operations; ++first) {
      for (const CutKind first_kind : kAllCutKinds) {
        for (const CutKind second_kind : kAllCutKinds) {
          // Repeated until the second power-on completes: its number of operations depends on the
          // first cut.
          bool interrupted = true;
          for (std::size_t second = 0; interrupted; ++second) {
            Device device = prepared(history, kShort, static_cast<std::uint32_t>(cases));
            device.flash().cut_at(first, first_kind);
            EXPECT_FALSE(device.run(kInstall, kDisturbed));
            device.flash().cut_at(second, second_kind);
            interrupted = !device.run(kInstall, kSecond);
            device.expect_settled();
            device.expect_usable(kLast);
            ++cases;
            ASSERT_FALSE(testing::Test::HasFailure())
                << history.name << ", operations " << first << " and " << second << ", kinds "
                << int(first_kind) << " and " << int(second_kind);
          }
        }
      }
    }
  }
  report("pairs of power cuts", cases);
  EXPECT_GT(cases, 10000u);
}

TEST(PowerCut, AfterAnOperationThatFailed) {
  constexpr std::size_t kShort = 12;
  std::size_t cases = 0;
  for (const History& history : kHistories) {
    const std::size_t operations = operations_of(history, kInstall, kShort);
    for (std::size_t failing = 0; failing < operations; ++failing) {
      for (std::size_t at = failing + 1; at <= operations; ++at) {
        for (const CutKind kind : kAllCutKinds) {
          Device device = prepared(history, kShort, static_cast<std::uint32_t>(cases));
          device.flash().cut_at(at, kind);
          device.flash().fail_at(failing);
          device.run(kInstall, kDisturbed);
          device.expect_settled();
          device.expect_usable(kLast);
          ++cases;
          ASSERT_FALSE(testing::Test::HasFailure())
              << history.name << ", failed operation " << failing << ", cut at " << at << ", kind "
              << int(kind);
        }
      }
    }
  }
  report("failed operations followed by a power cut", cases);
}

// The tests above rely on this: an image made of halves of two tables is not accepted.
TEST(PowerCut, MixedImage_IsRefusedByTheVerifier) {
  TestVerifier verifier;
  Image mixed = make_image(1, 40);
  const Image other = make_image(2, 40);
  std::copy(other.begin() + 20, other.end(), mixed.begin() + 20);
  EXPECT_EQ(verifier.verify(mixed), TableVerdict::kRefused);
}

}  // namespace
}  // namespace armtrue::storage
