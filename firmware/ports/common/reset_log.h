// Causes of resets: the cause that the hardware reports, and the cause that the software noted
// before it requested the reset. The record is in memory that a reset does not clear.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_RESET_LOG_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_RESET_LOG_H_

#include <cstdint>
#include <initializer_list>

#include "firmware/core/fixed/counter.h"

namespace armtrue::ports {

// 0x2040 sub 1; fits in four bits.
enum class ResetCause : std::uint8_t {
  kUnknown = 0,
  kPowerOn = 1,
  kBrownOut = 2,
  kPin = 3,
  kWatchdog = 4,        // independent watchdog: not fed in time by a sound joint path
  kWindowWatchdog = 5,  // the loop fed it too early or too late
  kSoftware = 6,        // not requested by this program: a debugger
  kNmt = 7,             // NMT reset node
  kFault = 8,           // the processor took a fault
  kMemoryFault = 9,     // a fault that the memory protection unit raised
  kClock = 10,          // the crystal failed
  kLowPower = 11,       // an illegal entry into a low-power mode
};

// Details of a fault that are kept over the reset.
struct FaultPlace {
  std::uint32_t instruction;  // its address
  std::uint32_t status;       // the processor's own status word
  std::uint32_t address;      // accessed address, if the processor knows it
};

struct ResetRecord {
  std::uint32_t magic;
  std::uint32_t noted;  // ResetCause, written before a requested reset
  std::uint32_t cause;  // of the last reset
  std::uint32_t resets;
  std::uint32_t history;  // eight causes of four bits, the newest in the lowest
  FaultPlace fault;       // of the last fault since power-on
  std::uint32_t check;
};

class ResetLog {
 public:
  // `record` is not owned.
  explicit constexpr ResetLog(ResetRecord& record) : record_(record) {}

  // Call once at start. `hardware`: cause that the reset controller reports; kSoftware also for a
  // reset that this program requested.
  void start(ResetCause hardware) {
    const bool is_kept = record_.magic == kMagic && record_.check == check();
    if (!is_kept || hardware == ResetCause::kPowerOn) record_ = {};
    record_.magic = kMagic;
    const auto noted = static_cast<ResetCause>(record_.noted);
    // A noted cause replaces a watchdog reset, because the noted fault came first, and kUnknown,
    // which an emulator without a reset controller reports.
    const bool is_by_program =
        hardware == ResetCause::kUnknown || hardware == ResetCause::kSoftware ||
        hardware == ResetCause::kWatchdog || hardware == ResetCause::kWindowWatchdog;
    const ResetCause cause = is_by_program && noted != ResetCause::kUnknown ? noted : hardware;
    record_.cause = static_cast<std::uint32_t>(cause);
    record_.noted = 0;
    count(record_.resets);
    record_.history = record_.history << 4U | record_.cause;
    record_.check = check();
  }

  // Call before a reset that the program requests.
  void note(ResetCause cause, const FaultPlace* fault = nullptr) {
    record_.noted = static_cast<std::uint32_t>(cause);
    if (fault != nullptr) record_.fault = *fault;
    record_.check = check();
  }

  ResetCause cause() const { return static_cast<ResetCause>(record_.cause); }
  // Starts since power-on, including this one.
  std::uint32_t resets() const { return record_.resets; }
  std::uint32_t history() const { return record_.history; }
  const FaultPlace& fault() const { return record_.fault; }

 private:
  static constexpr std::uint32_t kMagic = 0x52534554;  // "RSET"

  // Checksum: memory not written since power-on has arbitrary content.
  std::uint32_t check() const {
    std::uint32_t sum = 0x9E3779B9U;
    for (const std::uint32_t word :
         {record_.magic, record_.noted, record_.cause, record_.resets, record_.history,
          record_.fault.instruction, record_.fault.status, record_.fault.address}) {
      sum = (sum << 5U | sum >> 27U) ^ word;
    }
    return sum;
  }

  ResetRecord& record_;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_RESET_LOG_H_
