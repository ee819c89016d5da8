// Why the device was reset: what the hardware says, and what the software noted before it asked for
// the reset. The record lies in memory that a reset does not clear.
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
  kWatchdog = 4,        // independent watchdog: the joint path was not supervised in time
  kWindowWatchdog = 5,  // the loop fed it too early or too late
  kSoftware = 6,        // asked for by nobody here: a debugger
  kNmt = 7,             // NMT reset node
  kFault = 8,           // the processor took a fault
  kMemoryFault = 9,     // one that the memory protection unit raised
  kClock = 10,          // the crystal failed
  kLowPower = 11,       // an illegal entry into a low-power mode
};

// What of a fault is worth keeping.
struct FaultPlace {
  std::uint32_t instruction;  // its address
  std::uint32_t status;       // the processor's own status word
  std::uint32_t address;      // what was accessed, where the processor knows
};

struct ResetRecord {
  std::uint32_t magic;
  std::uint32_t noted;  // ResetCause, written by who is about to reset
  std::uint32_t cause;  // of the last reset
  std::uint32_t resets;
  std::uint32_t history;  // eight causes of four bits, the newest in the lowest
  FaultPlace fault;       // of the last fault since power came
  std::uint32_t check;
};

class ResetLog {
 public:
  // `record` is not owned.
  explicit constexpr ResetLog(ResetRecord& record) : record_(record) {}

  // At start, once. `hardware`: what the reset controller says; kSoftware where this program asked.
  void start(ResetCause hardware) {
    const bool is_kept = record_.magic == kMagic && record_.check == check();
    if (!is_kept || hardware == ResetCause::kPowerOn) record_ = {};
    record_.magic = kMagic;
    const auto noted = static_cast<ResetCause>(record_.noted);
    // A watchdog that strikes behind a fault hides nothing: the fault came first.
    // An emulator without a reset controller says nothing.
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

  // Before a reset that the program asks for.
  void note(ResetCause cause, const FaultPlace* fault = nullptr) {
    record_.noted = static_cast<std::uint32_t>(cause);
    if (fault != nullptr) record_.fault = *fault;
    record_.check = check();
  }

  ResetCause cause() const { return static_cast<ResetCause>(record_.cause); }
  // Starts since power came, this one included.
  std::uint32_t resets() const { return record_.resets; }
  std::uint32_t history() const { return record_.history; }
  const FaultPlace& fault() const { return record_.fault; }

 private:
  static constexpr std::uint32_t kMagic = 0x52534554;  // "RSET"

  // Memory that nobody wrote since power came holds anything.
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
