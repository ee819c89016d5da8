# Unit tests of the node under address and undefined-behaviour sanitizers. (Step 39 fuzzes the node.)
build_preset sanitize canopen_test canopen_soak_test
build/sanitize/firmware/canopen/canopen_test --gtest_brief=1
build/sanitize/firmware/testing/canopen_soak_test --gtest_brief=1
