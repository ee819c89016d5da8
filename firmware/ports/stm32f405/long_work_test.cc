// Long operations (the largest table, a save) against models of both watchdogs and of the flash.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "firmware/core/table/test_image.h"
#include "firmware/ports/common/device.h"
#include "firmware/ports/common/slot_parameters.h"
#include "firmware/ports/stm32f405/guarded_flash.h"
#include "firmware/ports/stm32f405/watchdogs.h"
#include "firmware/storage/simulated_flash.h"
#include "firmware/testing/simulated_port.h"

namespace armtrue::stm32f405 {
namespace {

using canopen::TableCommand;

// One chip at a time: the device's clock is a plain function.
struct Chip {
  double now_us = 1e6;
  // Window watchdog (RM0090, 21): T counts down every 4096 · 8 cycles of 42 MHz while its clock is
  // on.
  double window_left_us = 0;
  bool window_has_clock = false;
  // Independent watchdog (section 20), its oscillator at the fastest (DS8626, table 36).
  double independent_left_us = 0;
  double independent_us = 0;
  // Flash (DS8626, table 40) and the processor that reads it.
  double word_us = 16;
  double erase_us = 2e6;
  double read_byte_us = 0.12;
  std::vector<std::string> resets;

  void pass(double us) {
    now_us += us;
    independent_left_us -= us;
    if (window_has_clock) window_left_us -= us;
    if (window_has_clock && window_left_us <= 0) reset("window watchdog, fed too late");
    if (independent_left_us <= 0) reset("independent watchdog");
  }
  void reset(const char* why) {
    if (resets.empty()) resets.emplace_back(why);
  }
};
Chip chip;
std::uint64_t clock_us() { return static_cast<std::uint64_t>(chip.now_us); }

struct WindowRegisters {
  static constexpr double kStepUs = 4096.0 * 8.0 / 42.0;
  std::uint32_t read(std::uint32_t) const { return 0; }
  void write(std::uint32_t offset, std::uint32_t word) {
    if (offset != wwdg_bits::kCr) return;
    const double window_us = ((wwdg_bits::kWindow & 0x7FU) - 0x3FU) * kStepUs;
    if (chip.window_left_us > window_us) chip.reset("window watchdog, fed too early");
    chip.window_left_us = ((word & 0x7FU) - 0x3FU) * kStepUs;
  }
};
struct ClockRegisters {
  std::uint32_t enabled = 0;
  std::uint32_t read(std::uint32_t) const { return enabled; }
  void write(std::uint32_t, std::uint32_t word) {
    enabled = word;
    chip.window_has_clock = (word & wwdg_bits::kRccApb1Watchdog) != 0;
  }
};
struct IndependentRegisters {
  std::uint32_t read(std::uint32_t) const { return 0; }
  void write(std::uint32_t offset, std::uint32_t word) {
    constexpr double kFastestHz = 47'000;
    if (offset == iwdg_bits::kRlr) chip.independent_us = 1e6 * word * 256 / kFastestHz;
    if (word == iwdg_bits::kFeed) chip.independent_left_us = chip.independent_us;
  }
};
struct GoodSupply {
  bool is_low() const { return false; }
};

class SlowFlash final : public storage::Flash {
 public:
  std::size_t slot_size() const override { return cells_.slot_size(); }
  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override {
    chip.pass(chip.read_byte_us * static_cast<double>(data.size()));
    cells_.read(slot, offset, data);
  }
  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override {
    chip.pass(chip.word_us);
    return cells_.program(slot, offset, word);
  }
  bool erase(std::size_t slot) override {
    chip.pass(chip.erase_us);
    return cells_.erase(slot);
  }
  // Marks a slot as not erased.
  void soil(std::size_t slot) { cells_.word(slot, 100) = 0; }

 private:
  storage::SimulatedFlash cells_{128 * 1024, 1};
};

using Window = WindowWatchdog<WindowRegisters, ClockRegisters>;
using Independent = IndependentWatchdog<IndependentRegisters>;
using Guarded = GuardedFlash<SlowFlash, Independent, GoodSupply>;

// As main.cc puts them together.
class LongWorkTest : public ::testing::TestWithParam<double> {
 protected:
  LongWorkTest() {
    chip = Chip();
    chip.word_us = GetParam();
    for (std::size_t slot = 0; slot < storage::kSlots; ++slot) {
      table_cells_.soil(slot);
      parameter_cells_.soil(slot);
    }
    window_of_test = &window_;
    independent_.set_timeout(Independent::kUsualMs);
    parameters_.start();
    device_.start();
    independent_.feed();
    window_.start(clock_us());
  }

  void turn() {
    chip.pass(500);
    device_.turn([this] {
      independent_.feed();
      window_.feed(clock_us());
    });
  }
  // Sends a request to the SDO server. Returns whether it was answered without an abort.
  bool ask(std::initializer_list<int> request) {
    port_.deliver(canopen::make_frame(0x600 + kNodeId, request));
    bool done = false;
    for (int k = 0; k < 3; ++k) turn();
    for (const canopen::CanFrame& frame : port_.take_sent()) {
      done = done || (frame.id == 0x580U + kNodeId && frame.data[0] != 0x80);
    }
    return done;
  }
  bool write(int index, int sub, std::uint32_t value) {
    const auto byte = [value](int k) { return static_cast<int>(value >> (8 * k) & 0xFFU); };
    return ask({0x23, index & 0xFF, index >> 8, sub, byte(0), byte(1), byte(2), byte(3)});
  }
  bool command(TableCommand word) { return write(0x2012, 0, static_cast<std::uint32_t>(word)); }
  bool stage(const std::vector<std::uint8_t>& image) {
    const int size = static_cast<int>(image.size());
    bool done = ask({0x21, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0});
    for (std::size_t at = 0; done && at < image.size(); at += 7) {
      const std::size_t length = std::min<std::size_t>(7, image.size() - at);
      canopen::CanFrame frame = canopen::make_frame(0x600 + kNodeId, {0, 0, 0, 0, 0, 0, 0, 0});
      frame.data[0] = static_cast<std::uint8_t>(at / 7 % 2 << 4 | (7 - length) << 1 |
                                                (at + length == image.size()));
      std::copy_n(image.begin() + static_cast<std::ptrdiff_t>(at), length, frame.data + 1);
      port_.deliver(frame);
      turn();
      done = port_.take_sent().back().data[0] != 0x80;
    }
    return done;
  }
  // The largest table that a device accepts, filled up with data that nothing refers to.
  static std::vector<std::uint8_t> largest_table() {
    armtrue::tests::TestImage made(6);
    made.add_constant(0, 1e-4);
    const std::size_t without = made.image().size();
    armtrue::tests::Bytes data(kMaxImageLength - without - format::kDirectoryEntryLength, 0x5A);
    made.add(format::Section::kData, data);
    return made.image();
  }

  static constexpr int kNodeId = 0x20;
  static inline Window* window_of_test = nullptr;
  static void stand(bool stands) {
    stands ? window_of_test->pause(clock_us()) : window_of_test->resume(clock_us());
  }

  WindowRegisters window_registers_;
  ClockRegisters clock_registers_;
  IndependentRegisters independent_registers_;
  GoodSupply supply_;
  Window window_{window_registers_, clock_registers_};
  Independent independent_{independent_registers_};
  SlowFlash table_cells_;
  SlowFlash parameter_cells_;
  Guarded tables_{table_cells_, independent_, supply_};
  Guarded parameter_flash_{parameter_cells_, independent_, supply_};
  ports::SlotParameters parameters_{parameter_flash_};
  canopen::SimulatedPort port_;
  const ports::DeviceSettings settings_{.identity = {.robot_serial = {}, .joint_count = 6},
                                        .node_id = kNodeId,
                                        .serial_number = 1,
                                        .cycle_us = 1000};
  ports::Device device_{settings_,
                        {port_, nullptr, tables_, parameters_, &clock_us, nullptr, &stand}};
};

TEST_P(LongWorkTest, LargestTable_IsInstalledWithoutAReset) {
  const std::vector<std::uint8_t> image = largest_table();
  ASSERT_EQ(image.size(), kMaxImageLength);
  ASSERT_TRUE(stage(image));
  for (const TableCommand word : {TableCommand::kVerify, TableCommand::kCommit,
                                  TableCommand::kActivate, TableCommand::kConfirm}) {
    ASSERT_TRUE(command(word));
    EXPECT_EQ(chip.resets, std::vector<std::string>()) << static_cast<int>(word);
    for (int k = 0; k < 500; ++k) turn();
    EXPECT_EQ(chip.resets, std::vector<std::string>()) << "after " << static_cast<int>(word);
  }
}

TEST_P(LongWorkTest, Save_CausesNoReset) {
  ASSERT_TRUE(write(0x1010, 1, 0x65766173));
  for (int k = 0; k < 500; ++k) turn();
  EXPECT_EQ(chip.resets, std::vector<std::string>());
}

TEST_P(LongWorkTest, HangAfterASave_IsResetByTheWatchdog) {
  ASSERT_TRUE(write(0x1010, 1, 0x65766173));
  chip.pass(60'000);
  EXPECT_EQ(chip.resets, std::vector<std::string>{"window watchdog, fed too late"});
}

// Microseconds to program a word: typical and at most (DS8626, table 40).
INSTANTIATE_TEST_SUITE_P(Words, LongWorkTest, ::testing::Values(16.0, 100.0));

}  // namespace
}  // namespace armtrue::stm32f405
