// The files below configs/: all of them load, and default.yaml is what the program prints.
#include <gtest/gtest.h>

#include <filesystem>

#include "idol/base/rig.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

std::string read_text(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(Configs, DefaultIsWhatTheProgramPrints) {
  const auto printed = run_idol("config");
  ASSERT_EQ(printed.status, 0) << printed.err;
  EXPECT_EQ(read_text(fs::path(IDOL_CONFIG_DIR) / "default.yaml"), printed.out)
      << "an option has changed; bring the file up to date: idol config > configs/default.yaml";
}

TEST(Configs, DefaultChangesNothing) {
  const std::string file = (fs::path(IDOL_CONFIG_DIR) / "default.yaml").string();
  const auto loaded = run_idol("config --config " + file);
  EXPECT_EQ(loaded.status, 0) << loaded.err;
  EXPECT_EQ(loaded.out, run_idol("config").out);
}

TEST(Configs, EveryRigLoads) {
  int rigs = 0;
  for (const auto& entry : fs::directory_iterator(IDOL_CONFIG_DIR)) {
    if (entry.path().filename().string().rfind("rig_", 0) != 0) continue;
    ++rigs;
    Rig rig;
    ASSERT_NO_THROW(rig = load_rig({}, entry.path())) << entry.path();
    EXPECT_GT(rig.camera.width, 0) << entry.path();
    EXPECT_GT(rig.imu.rate_hz, 0) << entry.path();
    // The camera looks somewhere, from within half a metre of the IMU.
    EXPECT_LT(rig.T_i_c.p.norm(), 0.5) << entry.path();
  }
  EXPECT_GT(rigs, 0);
}

TEST(Configs, EveryPresetCanBePrintedAndReadBack) {
  const TempDir dir;
  for (const std::string name : {"realtime", "paper"}) {
    const auto printed = run_idol("config --preset " + name);
    ASSERT_EQ(printed.status, 0) << printed.err;
    const fs::path file = dir.write(name + ".yaml", printed.out);
    EXPECT_EQ(run_idol("config --config " + file.string()).out, printed.out) << name;
  }
}

TEST(Configs, CompletionAndManualKnowEveryCommand) {
  const std::string help = run_idol("--help").out;
  const std::string manual = read_text(fs::path(IDOL_CONFIG_DIR).parent_path() / "docs/idol.1");
  const TempDir dir;
  for (const std::string shell : {"bash", "zsh"}) {
    const auto script = run_idol("completion " + shell);
    ASSERT_EQ(script.status, 0) << script.err;
    for (const std::string command : {"run", "convert", "info", "segment", "evaluate", "simulate",
                                      "preintegrate", "report", "config", "completion"}) {
      EXPECT_NE(help.find("  " + command + " "), std::string::npos) << command;
      EXPECT_NE(script.out.find(command), std::string::npos) << command;
      EXPECT_NE(manual.find("idol " + command), std::string::npos) << command << " is not in docs/idol.1";
      EXPECT_NE(run_idol(command + " --help").out.find("Examples:"), std::string::npos) << command;
    }
    EXPECT_NE(script.out.find("--events-topic"), std::string::npos);
  }
  // Bash at least can be had everywhere: what follows "idol run --im".
  const fs::path file = dir.write(
      "completion.bash", run_idol("completion bash").out +
                             "COMP_WORDS=(idol run --im) COMP_CWORD=2\n_idol\necho \"${COMPREPLY[*]}\"\n");
  const fs::path out = dir.path() / "out";
  ASSERT_EQ(std::system(("bash " + file.string() + " >" + out.string()).c_str()), 0);
  EXPECT_EQ(read_text(out), "--imu-rig --imu-topic --imu\n");
}

TEST(Configs, CitationHasTheVersion) {
  std::string version = run_idol("--version").out;  // idol 1.2.3
  version.pop_back();
  const std::string citation = read_text(fs::path(IDOL_CONFIG_DIR).parent_path() / "CITATION.cff");
  EXPECT_NE(citation.find("\nversion: " + version.substr(version.find(' ') + 1) + "\n"), std::string::npos)
      << version;
}

// What the README promises is what is there.
TEST(Configs, ReadmeShowsTheExampleAndEveryPackage) {
  const fs::path root = fs::path(IDOL_CONFIG_DIR).parent_path();
  const std::string readme = read_text(root / "README.md");
  const std::string example = read_text(root / "examples/minimal.cpp");
  ASSERT_FALSE(example.empty());
  EXPECT_NE(readme.find(example), std::string::npos) << "README.md shows another examples/minimal.cpp";
  std::ifstream packages(root / "scripts/packages.txt");
  int count = 0;
  for (std::string name; std::getline(packages, name); ++count)
    EXPECT_NE(readme.find(name), std::string::npos) << name << " is not in README.md";
  EXPECT_GT(count, 10);
}

}  // namespace
}  // namespace idol::test
