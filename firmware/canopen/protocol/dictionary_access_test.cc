// SDO access to a DOMAIN and to ordinary objects, below the protocol.
#include "firmware/canopen/protocol/dictionary_access.h"

#include <gtest/gtest.h>

#include <vector>

#include "firmware/canopen/sdo/sdo_server.h"
#include "firmware/testing/simulated_port.h"

namespace armtrue::canopen {
namespace {

TEST(ObjectDictionaryTest, HasIndex_FindsAnObjectOfOneValue) {
  const ObjectDictionary dictionary;
  EXPECT_TRUE(dictionary.has_index(0x1001));
  EXPECT_FALSE(dictionary.has_index(0x1004));
}

TEST(ObjectDictionaryTest, ShorterString_ErasesTheRestOfTheOldOne) {
  ObjectDictionary dictionary;
  dictionary.set_string(od::kRobotSerial, "ROBOT-LONG");
  dictionary.set_string(od::kRobotSerial, "R2");
  const auto bytes = dictionary.bytes(*dictionary.find(od::kRobotSerial.index, 0));
  EXPECT_EQ(std::string(bytes.begin(), bytes.end()),
            std::string("R2").append(bytes.size() - 2, '\0'));
}

struct NoHooks final : ObjectHooks {
  Abort before_write(const od::Entry&, std::span<const std::uint8_t>) override {
    return Abort::kNone;
  }
  void after_write(const od::Entry&) override {}
  Abort before_read(std::uint16_t, std::uint8_t) override { return Abort::kNone; }
};

struct FakeDomain final : DomainHandler {
  Abort begin_download(std::uint16_t, std::uint32_t) override {
    is_open = true;
    return Abort::kNone;
  }
  Abort append(std::span<const std::uint8_t>) override { return Abort::kNone; }
  Abort finish_download() override {
    is_open = false;
    return Abort::kNone;
  }
  void cancel_download() override {
    is_open = false;
    ++cancelled;
  }
  Abort begin_upload(std::uint16_t, std::span<const std::uint8_t>&) override {
    return Abort::kNoData;
  }
  bool is_open = false;
  int cancelled = 0;
};

class DictionaryAccessTest : public testing::Test {
 protected:
  static constexpr std::uint16_t kDomain = 0x2010;

  DictionaryAccessTest() { dictionary.restore_defaults(0x20); }
  Abort begin_write(std::uint16_t index, std::uint8_t sub, std::uint32_t size = kUnknownSize) {
    return access.begin_write(index, sub, size, expected);
  }

  ObjectDictionary dictionary;
  NoHooks hooks;
  FakeDomain domain;
  DictionaryAccess access{dictionary, hooks, domain};
  std::uint32_t expected = 99;
};

TEST_F(DictionaryAccessTest, ExpectedSize_IsTheObjectsOrZeroIfVariable) {
  EXPECT_EQ(begin_write(0x1017, 0), Abort::kNone);
  EXPECT_EQ(expected, 2U);
  EXPECT_EQ(begin_write(kDomain, 0), Abort::kNone);
  EXPECT_EQ(expected, 0U);
}

TEST_F(DictionaryAccessTest, AnotherTransfer_CancelsTheDownloadOfADomain) {
  ASSERT_EQ(begin_write(kDomain, 0), Abort::kNone);
  EXPECT_EQ(begin_write(0x1017, 0), Abort::kNone);
  EXPECT_FALSE(domain.is_open);
  EXPECT_EQ(domain.cancelled, 1);
  access.cancel();
  EXPECT_EQ(domain.cancelled, 1) << "once";
}

TEST_F(DictionaryAccessTest, ADomainThatIsComplete_IsNotCancelled) {
  ASSERT_EQ(begin_write(kDomain, 0), Abort::kNone);
  ASSERT_EQ(access.finish_write(), Abort::kNone);
  access.cancel();
  EXPECT_EQ(domain.cancelled, 0);
}

TEST_F(DictionaryAccessTest, WritesToReadOnlyObjects_AreCounted) {
  for (std::uint32_t k = 0; k < 3; ++k) {
    EXPECT_EQ(access.refused_writes(), k);
    EXPECT_EQ(begin_write(0x1000, 0), Abort::kReadOnly);
  }
  EXPECT_EQ(begin_write(0x1017, 0), Abort::kNone);
  EXPECT_EQ(access.refused_writes(), 3U);
}

TEST_F(DictionaryAccessTest, ValuesOfTheWrongLength_AreRefused) {
  const std::vector<std::uint8_t> bytes = {0xE8, 0x03, 0x00};
  const std::span<const std::uint8_t> all(bytes);
  EXPECT_EQ(begin_write(0x1017, 0, 3), Abort::kTooLong);
  EXPECT_EQ(begin_write(0x1017, 0, 1), Abort::kTooShort);
  ASSERT_EQ(begin_write(0x1017, 0, 2), Abort::kNone);
  EXPECT_EQ(access.append(all), Abort::kTooLong);
  ASSERT_EQ(begin_write(0x1017, 0), Abort::kNone);
  EXPECT_EQ(access.append(all), Abort::kTooLong);
  ASSERT_EQ(access.append(all.first(1)), Abort::kNone);
  EXPECT_EQ(access.finish_write(), Abort::kTooShort);
  ASSERT_EQ(begin_write(0x1017, 0, 2), Abort::kNone);
  ASSERT_EQ(access.append(all.first(1)), Abort::kNone);
  EXPECT_EQ(access.finish_write(), Abort::kLength);
  ASSERT_EQ(begin_write(0x1017, 0, 2), Abort::kNone);
  ASSERT_EQ(access.append(all.first(1)), Abort::kNone);
  ASSERT_EQ(access.append(all.subspan(1, 1)), Abort::kNone);
  EXPECT_EQ(access.finish_write(), Abort::kNone);
  EXPECT_EQ(dictionary.get(od::kProducerHeartbeatTime), 1000);
}

TEST_F(DictionaryAccessTest, AnAbortOfTheClient_CancelsTheDomainAtOnce) {
  SimulatedPort port;
  SdoServer server(port, access);
  server.reset(0x620, 0x5A0);
  server.handle(make_frame(0x620, {0x21, 0x10, 0x20, 0, 9, 0, 0, 0}), 0);
  ASSERT_TRUE(domain.is_open);
  server.handle(make_frame(0x620, {0x80, 0x10, 0x20, 0, 0, 0, 0, 8}), 0);
  EXPECT_FALSE(domain.is_open);
}

}  // namespace
}  // namespace armtrue::canopen
