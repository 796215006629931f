# Sum the table of `coverage report` over the folders, and over the files beside them.
/\.py / {
    folder = $1
    sub("src/", "", folder)
    sub("^brownpipe/", "", folder)
    sub("[^/]*$", "", folder)
    if (folder == "") folder = "files beside the folders"
    statements[folder] += $2
    missed[folder] += $3
}
END {
    for (folder in statements) {
        share = 100 * (1 - missed[folder] / statements[folder])
        printf "%-36s %5d statements %5.1f %%\n", folder, statements[folder], share
    }
}
