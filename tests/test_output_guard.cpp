// Nothing of the user's is destroyed.
#include "idol/io/output_guard.hpp"

#include <gtest/gtest.h>

#include "idol/io/pending_file.hpp"
#include "idol/io/text_writer.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;
using test::slurp;
using test::TempDir;

TEST(PendingFile, ReplacesOnlyWhenCommitted) {
  const TempDir dir;
  const fs::path file = dir.write("a.txt", "old");
  {
    TextWriter writer(file);
    writer.write("half of the new");
  }
  EXPECT_EQ(slurp(file), "old");
  write_text_file(file, "new");
  EXPECT_EQ(slurp(file), "new");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 1)
      << "nothing is left over";
}

TEST(PendingFile, KeepsLinksAndRights) {
  const TempDir dir;
  const fs::path file = dir.write("a.txt", "old"), link = dir.path() / "link";
  fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
  fs::create_symlink("a.txt", link);
  write_text_file(link, "new");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(slurp(file), "new");
  EXPECT_EQ(fs::status(file).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_THROW(write_text_file(dir.path(), "x"), DataError) << "a folder is no file";
}

TEST(InputPaths, RefusesWhatIsHoldsOrLiesInAnInput) {
  const TempDir dir;
  fs::create_directories(dir.path() / "rec/sub");
  const fs::path rec = dir.path() / "rec", file = dir.write("rec/events.txt", "1"),
                 bag = dir.write("one.bag", "x");
  InputPaths inputs;
  inputs.add(rec);
  inputs.add(bag);
  inputs.add({});
  inputs.add(dir.path() / "absent");
  fs::create_directory_symlink(rec, dir.path() / "link");
  fs::create_hard_link(bag, dir.path() / "same.bag");
  fs::create_directory(dir.path() / "out");
  fs::create_hard_link(bag, dir.path() / "out/lines.csv");
  for (const fs::path& output :
       {rec, file, rec / "new", rec / "sub/deep/new", bag, dir.path() / "same.bag", dir.path() / "link",
        dir.path() / "link/events.txt", dir.path(), dir.path() / "out"})
    EXPECT_THROW(inputs.refuse_output(output), UsageError) << output;
  for (const fs::path& output : {dir.path() / "new", dir.path() / "other.bag", dir.path() / "record/x"})
    EXPECT_NO_THROW(inputs.refuse_output(output)) << output;
  EXPECT_NO_THROW(inputs.refuse_output("/dev/null"));
}

TEST(ClaimedFolders, TakeNothingOfTheUsers) {
  const TempDir dir;
  const fs::path mine = dir.path() / "mine", run = dir.path() / "run";
  fs::create_directories(mine);
  claim_folder(mine, FolderContent::kRun);  // empty
  dir.write("run", "");
  EXPECT_THROW(claim_folder(run, FolderContent::kRun), DataError) << "a file";
  fs::remove(run);
  fs::create_directories(run);
  dir.write("run/photo.png", "mine");
  EXPECT_THROW(claim_folder(run, FolderContent::kRun), UsageError);
  EXPECT_THROW(claim_and_clear_pictures(run), UsageError);
  remove_pictures(run);
  EXPECT_EQ(slurp(run / "photo.png"), "mine");
  claim_folder(mine, FolderContent::kRun);
  EXPECT_THROW(claim_folder(mine, FolderContent::kRecording), UsageError)
      << "a run's folder is no recording's";
}

TEST(ClaimedFolders, ALogThatTheShellMadeIsNoObstacle) {
  const TempDir dir;
  dir.write("run.log", "");
  claim_folder(dir.path(), FolderContent::kRun);
  EXPECT_TRUE(is_claimed(dir.path(), FolderContent::kRun));
}

TEST(ClaimedFolders, PicturesAreClearedAndRemovedButNothingElse) {
  const TempDir dir;
  const fs::path folder = dir.path() / "pictures";
  claim_and_clear_pictures(folder);
  dir.write("pictures/window_1.png", "");
  dir.write("pictures/notes.txt", "mine");
  remove_pictures(folder);
  EXPECT_FALSE(fs::exists(folder / "window_1.png"));
  EXPECT_EQ(slurp(folder / "notes.txt"), "mine");
  fs::remove(folder / "notes.txt");
  remove_pictures(folder);
  EXPECT_FALSE(fs::exists(folder));
}

}  // namespace
}  // namespace idol
