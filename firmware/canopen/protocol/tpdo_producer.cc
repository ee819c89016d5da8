#include "firmware/canopen/protocol/tpdo_producer.h"

#include <cstring>

namespace armtrue::canopen {
namespace {

constexpr std::uint8_t kAcyclicSync = 0;

bool is_joint_output(const Pdo& pdo) { return pdo.mapping.has_axis_object(kPositionOffset); }

bool same(const CanFrame& one, const CanFrame& other) {
  return one.len == other.len && std::memcmp(one.data, other.data, one.len) == 0;
}

}  // namespace

void TpdoProducer::restart(std::uint64_t now_us) {
  for (std::size_t k = 0; k < kTpdos; ++k) {
    schedules_[k] = {};
    schedules_[k].event_due_us =
        now_us + dictionary_.get(od::tpdo::kEventTimer[k]) * std::uint64_t{1000};
  }
}

void TpdoProducer::sample(const Pdo& pdo, CanFrame& frame) {
  for (const MappedEntry& mapped : pdo.mapping.used()) hooks_.before_read(mapped.index, mapped.sub);
  sample_tpdo(dictionary_, pdo, frame);
}

bool TpdoProducer::transmit(CanPort& port, std::size_t number, const CanFrame& frame,
                            std::uint64_t now_us, std::uint32_t cycle) {
  const auto axes = static_cast<std::uint8_t>(offset_axes(number));
  const Command command = {axes, static_cast<std::uint8_t>(cycle)};
  if (!(axes != 0 ? port.send_command(frame, command) : port.send(frame))) return false;
  Schedule& schedule = schedules_[number];
  schedule.last = frame;
  schedule.has_last = true;
  schedule.fresh = false;
  // 0x1800 sub 3 counts in 100 µs, sub 5 in ms.
  schedule.inhibited_until_us =
      now_us + dictionary_.get(od::tpdo::kInhibitTime[number]) * std::uint64_t{100};
  schedule.event_due_us =
      now_us + dictionary_.get(od::tpdo::kEventTimer[number]) * std::uint64_t{1000};
  return true;
}

std::uint32_t TpdoProducer::on_fresh_outputs(CanPort& port, std::uint32_t cycle,
                                             std::uint64_t now_us, bool at_once) {
  std::uint32_t refused = 0;
  for (std::size_t k = 0; k < kTpdos; ++k) {
    const Pdo& pdo = pdos_.tpdo(k);
    if (!pdo.valid || !is_joint_output(pdo)) continue;
    schedules_[k].fresh = true;
    if (pdo.is_synchronous() && !at_once) continue;
    CanFrame frame;
    sample_tpdo(dictionary_, pdo, frame);
    if (!transmit(port, k, frame, now_us, cycle)) ++refused;
  }
  return refused;
}

bool TpdoProducer::is_due_on_sync(std::size_t number, std::uint8_t counter) {
  Schedule& schedule = schedules_[number];
  const std::uint8_t type = pdos_.tpdo(number).transmission;
  if (type == kAcyclicSync) return true;
  const std::uint8_t start = dictionary_.get(od::tpdo::kSYNCStartValue[number]);
  if (!schedule.started) {
    schedule.started = start == 0 || counter == 0 || counter == start;
    if (!schedule.started) return false;
    if (start != 0 && counter != 0) {
      schedule.syncs = 0;
      return true;
    }
  }
  if (++schedule.syncs < type) return false;
  schedule.syncs = 0;
  return true;
}

std::uint32_t TpdoProducer::on_sync(CanPort& port, std::uint8_t counter, std::uint32_t cycle,
                                    std::uint64_t now_us) {
  std::uint32_t refused = 0;
  for (std::size_t k = 0; k < kTpdos; ++k) {
    const Pdo& pdo = pdos_.tpdo(k);
    if (!pdo.valid || !pdo.is_synchronous() || !is_due_on_sync(k, counter)) continue;
    const bool joint = is_joint_output(pdo);
    if (joint && !schedules_[k].fresh) continue;
    CanFrame frame;
    sample(pdo, frame);
    const bool unchanged = schedules_[k].has_last && same(schedules_[k].last, frame);
    if (pdo.transmission == kAcyclicSync && !joint && unchanged) continue;
    if (!transmit(port, k, frame, now_us, cycle) && joint) ++refused;
  }
  return refused;
}

std::uint32_t TpdoProducer::unsent() const {
  std::uint32_t axes = 0;
  for (std::size_t k = 0; k < kTpdos; ++k) {
    if (schedules_[k].fresh) axes |= offset_axes(k);
  }
  return axes;
}

void TpdoProducer::process(CanPort& port, std::uint64_t now_us) {
  for (std::size_t k = 0; k < kTpdos; ++k) {
    const Pdo& pdo = pdos_.tpdo(k);
    if (!pdo.valid || pdo.is_synchronous() || is_joint_output(pdo)) continue;
    const Schedule& schedule = schedules_[k];
    if (now_us < schedule.inhibited_until_us) continue;
    CanFrame frame;
    sample(pdo, frame);
    const bool changed = !schedule.has_last || !same(schedule.last, frame);
    const bool timed =
        dictionary_.get(od::tpdo::kEventTimer[k]) != 0 && now_us >= schedule.event_due_us;
    if (changed || timed) transmit(port, k, frame, now_us);
  }
}

}  // namespace armtrue::canopen
