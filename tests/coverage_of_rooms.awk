# Sum the table of `coverage report` over the rooms: folders, and files beside them.
/\.py / {
    room = $1
    sub("src/", "", room)
    sub("^brownpipe/", "", room)
    sub("[^/]*$", "", room)
    if (room == "") room = "files beside the folders"
    statements[room] += $2
    missed[room] += $3
}
END {
    for (room in statements) {
        share = 100 * (1 - missed[room] / statements[room])
        printf "%-36s %5d statements %5.1f %%\n", room, statements[room], share
    }
}
