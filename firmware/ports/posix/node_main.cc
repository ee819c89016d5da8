// armtrue_node: the compensator as a Linux process on SocketCAN.
//
//   armtrue_node --upstream vcan0 [--downstream vcan1] --state DIR [options]
//
// Exits 0 on SIGTERM or SIGINT, 2 with one sentence on stderr if it cannot start.
#include <poll.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/ports/common/device.h"
#include "firmware/ports/posix/file_flash.h"
#include "firmware/ports/posix/socketcan_port.h"

namespace {

struct Options {
  std::string upstream;
  std::string downstream;
  std::string state;
  std::string serial;
  std::string key_file;
  unsigned node_id = 0x20;
  unsigned serial_number = 1;
  unsigned joints = 6;
  unsigned cycle_us = 1000;
  unsigned priority = 0;
  bool help = false;
};

constexpr char kUsage[] =
    "armtrue_node --upstream IF [--downstream IF] --state DIR [options]\n"
    "  --upstream IF        SocketCAN interface of the controller (fd:N: an inherited socket)\n"
    "  --downstream IF      SocketCAN interface of the drives (inline mode; absent: offset mode)\n"
    "  --state DIR          where table slots and saved parameters live; of this node alone\n"
    "  --node-id N          1..127 (default 32)\n"
    "  --serial-number N    of this device, object 0x1018 sub 4 (default 1)\n"
    "  --robot-serial TEXT  take only this robot's tables (default: any)\n"
    "  --public-key FILE    of armtrue keygen (NAME.pub): take only tables signed with NAME\n"
    "  --joints N           1..8 (default 6)\n"
    "  --cycle-us N         control period (default 1000)\n"
    "  --priority N         run under SCHED_FIFO, 1..99, memory locked (default: neither)\n";

volatile std::sig_atomic_t stop_requested = 0;

void request_stop(int) { stop_requested = 1; }

// Host time of the last start or reset of the device. now_us() counts from it, like a chip's clock,
// which a reset sets to zero: terms in `time` (warm_up) take it as the time since the arm was
// switched on.
std::uint64_t life_began_us = 0;

std::uint64_t now_us() { return armtrue::posix::host_us() - life_began_us; }

int fail(const std::string& sentence) {
  std::fprintf(stderr, "armtrue_node: %s\n", sentence.c_str());
  return 2;
}

std::string parse_number(const std::string& name, const std::string& text, unsigned low,
                         unsigned high, unsigned& value) {
  const bool hex = text.starts_with("0x");
  const char* begin = text.data() + (hex ? 2 : 0);
  const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value, hex ? 16 : 10);
  const bool good =
      error == std::errc() && end == text.data() + text.size() && value >= low && value <= high;
  if (good) return "";
  return name + ": '" + text + "', expected a number from " + std::to_string(low) + " to " +
         std::to_string(high);
}

// Empty if the command line is good.
std::string parse(const std::vector<std::string>& arguments, Options& options) {
  for (std::size_t k = 0; k < arguments.size(); ++k) {
    const std::string& name = arguments[k];
    if (name == "--help") {
      options.help = true;
      return "";
    }
    if (k + 1 == arguments.size()) return name + ": unknown, or its value is missing";
    const std::string& value = arguments[++k];
    std::string problem;
    if (name == "--upstream") {
      options.upstream = value;
    } else if (name == "--downstream") {
      options.downstream = value;
    } else if (name == "--state") {
      options.state = value;
    } else if (name == "--robot-serial") {
      options.serial = value;
      if (value.size() > armtrue::kSerialLength) {
        problem = name + ": longer than " + std::to_string(armtrue::kSerialLength) + " characters";
      }
    } else if (name == "--public-key") {
      options.key_file = value;
    } else if (name == "--node-id") {
      problem = parse_number(name, value, 1, 127, options.node_id);
    } else if (name == "--serial-number") {
      problem = parse_number(name, value, 0, UINT32_MAX, options.serial_number);
    } else if (name == "--joints") {
      problem = parse_number(name, value, 1, armtrue::kMaxJoints, options.joints);
    } else if (name == "--cycle-us") {
      problem = parse_number(name, value, 100, 1'000'000, options.cycle_us);
    } else if (name == "--priority") {
      problem = parse_number(name, value, 1, 99, options.priority);
    } else {
      problem = name + ": unknown option";
    }
    if (!problem.empty()) return problem;
  }
  if (options.upstream.empty()) return "--upstream is needed";
  if (options.state.empty()) return "--state is needed";
  // On one interface the node would receive each frame that it forwards and forward it for ever.
  if (options.downstream == options.upstream) {
    return "--downstream: '" + options.downstream +
           "' is the interface of --upstream, expected another one, or no --downstream for offset "
           "mode";
  }
  return "";
}

// Base64 (RFC 4648, 4) of exactly 32 bytes.
bool decode_key(const std::string& text, std::array<std::uint8_t, 32>& key) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  if (text.size() != 44 || text.back() != '=') return false;
  std::uint32_t bits = 0;
  std::size_t done = 0;
  for (std::size_t k = 0; k < 43; ++k) {
    const char* digit = std::strchr(kDigits, text[k]);
    if (digit == nullptr || *digit == '\0') return false;
    bits = bits << 6 | static_cast<std::uint32_t>(digit - kDigits);
    // Four digits encode three bytes; the last three digits encode two.
    const std::size_t whole = (k + 1) * 6 / 8;
    if (whole > done) key[done++] = static_cast<std::uint8_t>(bits >> ((k + 1) * 6 % 8));
  }
  return (bits & 3U) == 0;
}

// Reads the public key file that `armtrue keygen` writes beside the secret one. Empty if it worked.
std::string read_key(const std::string& path, armtrue::DeviceIdentity& device) {
  if (path.empty()) return "";
  std::ifstream file(path);
  if (!file) return path + ": " + std::strerror(errno);
  std::string head;
  std::string text;
  file >> head >> text;
  if (head != "armtrue-ed25519-public" || !decode_key(text, device.public_key)) {
    return path + ": expected a public key as 'armtrue keygen' writes it (NAME.pub)";
  }
  device.has_key = true;
  return "";
}

// Runs this process ahead of all ordinary processes, with its memory locked so that it never waits
// for a page. Empty if it worked.
std::string run_in_real_time(unsigned priority) {
  if (priority == 0) return "";
  sched_param wanted = {};
  wanted.sched_priority = static_cast<int>(priority);
  if (sched_setscheduler(0, SCHED_FIFO, &wanted) != 0) {
    return std::string("--priority: the kernel refuses SCHED_FIFO: ") + std::strerror(errno) +
           "; needs CAP_SYS_NICE or a limit of real-time priority (ulimit -r)";
  }
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    return std::string("--priority: memory cannot be locked: ") + std::strerror(errno) +
           "; needs CAP_IPC_LOCK or a limit of locked memory (ulimit -l)";
  }
  return "";
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  if (const std::string problem = parse({argv + 1, argv + argc}, options); !problem.empty()) {
    return fail(problem);
  }
  if (options.help) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  armtrue::ports::DeviceSettings settings = {
      .identity = {.joint_count = static_cast<std::uint8_t>(options.joints)},
      .node_id = static_cast<std::uint8_t>(options.node_id),
      .serial_number = options.serial_number,
      .cycle_us = options.cycle_us};
  armtrue::DeviceIdentity& identity = settings.identity;
  options.serial.copy(identity.robot_serial.data(), identity.robot_serial.size());
  if (const std::string problem = read_key(options.key_file, identity); !problem.empty()) {
    return fail(problem);
  }
  if (mkdir(options.state.c_str(), 0755) != 0 && errno != EEXIST) {
    return fail(options.state + ": " + std::strerror(errno));
  }
  armtrue::posix::FolderLock lock;
  if (const std::string problem = lock.take(options.state); !problem.empty()) return fail(problem);
  armtrue::posix::FileFlash flash(armtrue::kMaxImageLength + armtrue::storage::kHeaderBytes);
  if (const std::string problem = flash.open(options.state + "/slots.bin"); !problem.empty()) {
    return fail(problem);
  }
  armtrue::posix::FileParameters parameters(options.state + "/parameters.bin");
  armtrue::posix::SocketCanPort upstream;
  if (const std::string problem = upstream.open(options.upstream); !problem.empty()) {
    return fail(problem);
  }
  std::optional<armtrue::posix::SocketCanPort> downstream;
  if (!options.downstream.empty()) {
    downstream.emplace();
    if (const std::string problem = downstream->open(options.downstream); !problem.empty()) {
      return fail(problem);
    }
  }
  if (const std::string problem = run_in_real_time(options.priority); !problem.empty()) {
    return fail(problem);
  }
  std::signal(SIGTERM, request_stop);
  std::signal(SIGINT, request_stop);

  std::array<pollfd, 2> waits = {{{upstream.descriptor(), POLLIN, 0}, {-1, POLLIN, 0}}};
  if (downstream) waits[1].fd = downstream->descriptor();
  while (stop_requested == 0) {
    // One run of the device, from power-on to reset or stop. All RAM content is new.
    life_began_us = armtrue::posix::host_us();
    const armtrue::ports::DeviceParts parts = {upstream, downstream ? &*downstream : nullptr, flash,
                                               parameters, &now_us};
    const auto device = std::make_unique<armtrue::ports::Device>(settings, parts);
    device->start();
    while (stop_requested == 0 && device->turn([] {})) poll(waits.data(), waits.size(), 1);
  }
  return 0;
}
