// The compensator as a CANopen device: routes frames between services, the joint path and the two
// buses.
//
//   upstream  ── controller, clients ──┐
//                                      ├─ Node ─ NMT, heartbeat, SDO, EMCY, PDO, tables
//   downstream ── drives ──────────────┘
//
// With a downstream port every frame is passed on bit-identical, both ways, except: requests to
// this node's own SDO server, and in inline mode the target frames (held, rewritten, released as a
// set; a stop command in one passes at once; withheld if their mapping has ended under a
// correction) and the actual-position frames (rewritten). NMT and SYNC are obeyed from upstream
// only.
//
// The port calls process() repeatedly from one context. Only table commands and writes that erase
// flash block. Table commands are refused while joint commands arrive. An erase stops forwarding
// for seconds and is refused unless the drives are disabled or silent.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_NODE_NODE_H_
#define ARMTRUE_FIRMWARE_CANOPEN_NODE_NODE_H_

#include <array>
#include <cstdint>
#include <optional>

#include "firmware/canopen/motion/joint_path.h"
#include "firmware/canopen/node/bus_watch.h"
#include "firmware/canopen/node/parameter_store.h"
#include "firmware/canopen/node/port_health.h"
#include "firmware/canopen/node/withheld_targets.h"
#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/dictionary_access.h"
#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/nmt.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/pdo.h"
#include "firmware/canopen/protocol/tpdo_producer.h"
#include "firmware/canopen/sdo/sdo_server.h"
#include "firmware/canopen/table/table_transfer.h"

namespace armtrue::canopen {

struct NodeConfig {
  std::uint8_t node_id;         // 1..127
  std::uint32_t serial_number;  // 0x1018 sub 4
  std::uint8_t joint_count;
  std::uint64_t (*clock_us)();  // for measuring cycles
};

// Parts that the node uses; none is owned, all outlive the node.
struct NodeParts {
  CanPort& upstream;
  CanPort* downstream;  // nullptr: there is one bus, and inline mode is refused
  Compensator& compensator;
  storage::SlotStore& store;
  ParameterStore& parameters;
  const DeviceIdentity& device;
  TableMemory buffers;
  const PortHealth* health = nullptr;  // nullptr: not available
  // Called before (true) and after (false) a request that may take longer than any turn of the
  // loop while the arm moves: signature check, flash write. nullptr: the port does not supervise
  // the loop time.
  void (*note_long_request)(bool begins) = nullptr;
};

// What the port has to do after process().
enum class NodeAction : std::uint8_t {
  kNone,
  kRestart,  // NMT reset node: start again from power-on
};

class Node final : private ObjectHooks, private DriveGuard {
 public:
  Node(const NodeConfig& config, const NodeParts& parts);
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  // Loads the saved parameters and the table from the slots. Call once, then process() for ever.
  void start(std::uint64_t now_us);

  // Takes what has arrived, runs timers, sends what is due.
  NodeAction process(std::uint64_t now_us);

  // Whether the last process() supervised the joint path, and in time. Feed the watchdog only if
  // it is true.
  bool joint_path_sound() const { return joint_path_sound_; }

  NmtState nmt_state() const { return nmt_.state(); }
  const JointCounters& joint_counters() const { return joints_.counters(); }
  const ObjectDictionary& dictionary() const { return dictionary_; }

 private:
  // Frames taken from one port before the other has its turn.
  static constexpr int kFramesPerTurn = 16;
  // Frames from one bus for the other: passed on, or refused by the other port.
  struct Forwarding {
    std::uint32_t forwarded = 0;
    std::uint32_t dropped = 0;
  };

  void reset_communication(std::uint64_t now_us);
  void apply_configuration();
  // Takes the PDOs from the dictionary.
  void configure_pdos();
  // Whether target frames of a set that has lost its mapping are withheld; reports it.
  bool withholds();
  void handle_upstream(const CanFrame& frame);
  void handle_downstream(CanFrame& frame);
  // Serves NMT, heartbeat and SDO frames. True if the frame is for this node only.
  bool serve(const CanFrame& frame);
  bool is_sync(const CanFrame& frame) const;
  void handle_sync(const CanFrame& frame);
  void obey_sync(const CanFrame& frame);
  void note_nmt_command(std::uint8_t command);
  void handle_heartbeat(const CanFrame& frame);
  void handle_rpdo(std::size_t number, const CanFrame& frame);
  // Whether a frame is as long as its mapping; reports and counts one that is not.
  bool is_whole(std::size_t number, const CanFrame& frame);
  // Keeps the newest frame of each synchronous input; false if there is no room.
  bool keep_for_sync(std::size_t number, const CanFrame& frame);
  bool holds_correction() const;
  bool is_free_of_correction() const;
  bool may_change_resolution() const;
  bool all_say_disabled(std::uint8_t passive = 0) const;
  bool drives_are_off(std::uint8_t passive) const;
  bool may_erase(std::uint8_t passive) const override;
  bool may_change_axes(std::uint8_t passive) const override;
  void outputs_are_fresh();
  // Carries out NMT commands and mode changes. In offset mode those that end the output wait until
  // the drives' offsets are zero.
  void carry_out();
  void watch_sdo_targets(const CanFrame& frame);
  // Passes a frame on to the drives' bus. Returns whether the bus took it.
  bool to_drives(const CanFrame& frame);
  void communication_error();
  void watch_buses();
  void note_nmt_state();
  void refresh_bus(CanPort& port, const Forwarding& from, od::Ref<std::uint8_t> state,
                   od::Ref<std::uint32_t> received);
  void refresh_status();
  void refresh_drive_states();
  void refresh_timing();
  void refresh_health();
  void run_self_test(std::uint8_t tests);
  bool is_quiet() const;
  Mode mode() const { return joints_.mode(); }  // in force; 0x2000 sub 1 holds the requested one

  Abort before_write(const od::Entry& entry, std::span<const std::uint8_t> value) override;
  void after_write(const od::Entry& entry) override;
  Abort before_read(std::uint16_t index, std::uint8_t sub) override;
  Abort check_write(const od::Entry& entry, std::span<const std::uint8_t> value);
  Abort check_communication_write(const od::Entry& entry, std::span<const std::uint8_t> value);

  NodeConfig config_;
  NodeParts parts_;
  ObjectDictionary dictionary_;
  Nmt nmt_;
  HeartbeatConsumer heartbeats_;
  Emcy emcy_;
  PdoTable pdos_;
  JointPath joints_;
  TableTransfer tables_;
  DictionaryAccess access_;
  SdoServer sdo_;
  TpdoProducer tpdos_;
  BusWatch upstream_watch_;
  std::optional<BusWatch> downstream_watch_;

  std::uint64_t now_us_ = 0;
  NmtState known_state_ = NmtState::kInitialising;
  bool has_unsaved_ = false;      // the next start will have other parameters than these
  std::uint8_t nmt_command_ = 0;  // to be carried out, 0 for none
  NmtRequest pending_reset_ = NmtRequest::kNone;
  bool joint_path_sound_ = false;
  WithheldTargets withheld_;
  Forwarding from_upstream_;
  Forwarding from_downstream_;
  std::uint64_t drives_heard_us_ = 0;  // last frame from downstream
  bool has_heard_drives_ = false;
  std::uint32_t sdo_targets_ = 0;
  std::uint32_t short_rpdos_ = 0;  // bit r: the last frame of RPDO r was too short; no targets
  Latency sync_latency_;
  Latency sync_jitter_;  // difference to the latency of the SYNC before
  std::uint32_t last_sync_latency_us_ = 0;
  // Synchronous inputs (temperatures, payload) wait here for SYNC. If there is no room, an input is
  // taken at once.
  struct Waiting {
    CanFrame frame;
    std::uint8_t rpdo = 0;
  };
  std::array<Waiting, 4> waiting_ = {};
  std::size_t waiting_count_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_NODE_NODE_H_
