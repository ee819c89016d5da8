// When target frames came, and when sets went out.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_MOTION_STREAM_WATCH_H_
#define ARMTRUE_FIRMWARE_CANOPEN_MOTION_STREAM_WATCH_H_

#include <algorithm>
#include <cstdint>

namespace armtrue::canopen {

class StreamWatch {
 public:
  // EMCY 0xFF15 is raised if targets come for this long and no set goes out.
  static constexpr std::uint64_t kWithheldUs = 100'000;

  // A target frame was on the bus, whether or not it is used. The wait for a set begins with the
  // first one after the last set or after a pause. A controller slower than kWithheldUs does not
  // send cyclic positions.
  void note_command(std::uint64_t now_us, std::uint64_t stale_us) {
    const std::uint64_t pause_us = std::max(stale_us, kWithheldUs);
    if (waiting_since_us_ <= last_set_us_ || now_us - last_target_us_ > pause_us) {
      waiting_since_us_ = now_us;
    }
    has_target_ = true;
    last_target_us_ = now_us;
  }
  // The frame was given to the set.
  void note_taken(std::uint64_t now_us) { last_taken_us_ = now_us; }
  void note_set_out(std::uint64_t now_us) {
    streaming_ = true;
    last_set_us_ = now_us;
  }
  void interrupt() { streaming_ = false; }
  void end_wait() { waiting_since_us_ = last_set_us_; }

  bool is_streaming() const { return streaming_; }
  // Whether the stream goes on, and its last set is older than `limit_us`.
  bool is_late(std::uint64_t now_us, std::uint64_t limit_us) const {
    return streaming_ && now_us - last_set_us_ > limit_us;
  }
  // Whether the last target frame was given to the set.
  bool takes_targets() const { return last_taken_us_ == last_target_us_; }
  bool waits_too_long() const {
    return waiting_since_us_ > last_set_us_ && last_target_us_ - waiting_since_us_ > kWithheldUs;
  }
  // Microseconds since the last target frame; a large number before the first.
  std::uint64_t quiet_us(std::uint64_t now_us) const {
    return has_target_ ? now_us - last_target_us_ : UINT64_MAX;
  }

 private:
  bool streaming_ = false;
  bool has_target_ = false;
  std::uint64_t last_target_us_ = 0;
  std::uint64_t last_taken_us_ = 0;
  std::uint64_t waiting_since_us_ = 0;
  std::uint64_t last_set_us_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_MOTION_STREAM_WATCH_H_
